"""Fault detection and isolation for twist, gyro, accelerometer and wheel speeds.

Four extended Kalman filters run side by side on the state ``(u_x, u_y, Omega, b_g, b_x, b_y)``:
velocity ``u = v + Omega k x p`` of the mounting ``p`` of the IMU, in the body frame, yaw rate, and
the biases of gyro and accelerometer. One uses all sources, each of the others excludes one of
twist, gyro and accelerometer. At the mounting the specific force ``f`` needs no angular
acceleration,

    u' = R(-Omega dt) u + R(-Omega dt / 2) (f - b) dt

and without an accelerometer the velocity is a random walk within the acceleration that tires allow.
The measurements are

    gyro           Omega + b_g
    twist          v = u - Omega k x p, Omega          (at its own stamp)
    rolling wheel  n_w . u + (lever + n_wx p_y - n_wy p_x) Omega = R omega n_w . u_w

A wheel rolls while the pedal is up, and once its brake has been released for long enough for it to
spin up; it measures one component of the motion, independently of IMU and twist. A late twist is
compared with the state at its stamp and corrects the current one.

Isolation compares the filters. The velocities without twist and without accelerometer must agree,
and the yaw rates without twist and without gyro, within a gate. Beyond it one of two sources is
faulty, and three tests decide: the rolling wheels' innovations in the filter that uses it; for a
velocity, the deceleration that braking causes and tires limit; for a yaw rate, the change of the
twist's velocity. In axes that turn with the gyro ``U' = f`` if the gyro is right; with the twist's
own rate it changes by another ``(Omega - gyro) k x U``. Both are accumulated over `memory`; a twist
that neither explains is faulty itself. An isolated source is excluded until it has agreed for
`recovery_time`. Without a decision within `patience` there is no valid estimate. Without an IMU
the twist must fit the rolling wheels.

Two tests do not compare pairs. A twist whose step the gate refuses is isolated in a dispute. A
filter without a valid twist that the rolling wheels contradict gives no valid estimate. A fault
that two sources share passes these comparisons; `wheel_monitor` and `effect_monitor` bound it.
"""
