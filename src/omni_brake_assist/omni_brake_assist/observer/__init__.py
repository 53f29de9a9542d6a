"""A second opinion on the motion: who of twist, gyro, accelerometer and wheels is to be believed.

Four extended Kalman filters run side by side on the state ``(u_x, u_y, Omega, b_g, b_x, b_y)``:
velocity ``u = v + Omega k x p`` of the place ``p`` where the IMU is mounted, in the body frame, yaw
rate, and the biases of gyro and accelerometer. One hears everybody, each of the others leaves one
of twist, gyro and accelerometer out. At the mounting the specific force ``f`` needs no angular
acceleration,

    u' = R(-Omega dt) u + R(-Omega dt / 2) (f - b) dt

and without an accelerometer the velocity walks at random within what tires can do. Measured are

    gyro           Omega + b_g
    twist          v = u - Omega k x p, Omega          (at its own stamp: see below)
    rolling wheel  n_w . u + (lever + n_wx p_y - n_wy p_x) Omega = R omega n_w . u_w

A wheel rolls while the pedal is up, and when its brake has been released for long enough for it to
have spun up; it says one component of the motion exactly and knows neither of the IMU nor
of the twist. A twist that comes late is compared with the state of its stamp and corrects that of
now, so the answer is always of now.

Consistency decides whom to believe (parity by leaving one out). The filters without twist and
without accelerometer must agree on the velocity, those without twist and without gyro on the yaw
rate. Where they do not, one of two channels lies. Witnesses say which: the wheels that roll
contradict the filter that believes it; in a dispute about the velocity, who sees none of the loss
that braking wheels cause is wrong; in one about the yaw rate, the right one explains how the
velocity of the twist changes. A twist that leaps, or that braking does not change, has no case.
In axes that turn with the gyro ``U' = f`` if the gyro is right; by
the twist's own rate it should change by another ``(Omega - gyro) k x U``. Both are added up over
the last `memory`, so that a rate that is off by little shows too; a twist that neither explains is
wrong itself. What is convicted is left out until it has agreed with
the others for a while, the third time until the pedal is released. Until there is a verdict the
filter that fits better is used; if there is none in time, nobody is believed. A wheel that
contradicts all filters is not heard. Without an IMU the twist must fit the wheels that roll, and
lose speed.
"""
