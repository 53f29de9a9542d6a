"""Fault detection and isolation by a bank of hypotheses (multiple-model estimation).

Each hypothesis states which sources are faulty: none, the twist, only its velocity, only its yaw
rate, the gyro, the accelerometer, the whole IMU, or too many to estimate the motion. Each
hypothesis except the last has an extended Kalman filter that does not use the faulty sources. The
state of the filter is ``(u_x, u_y, Omega, b_g, b_x, b_y, s, o)``. ``u = v + Omega k x p`` is the
velocity of the point ``p`` at which the IMU is mounted, in the body frame, and ``Omega`` the yaw
rate. ``b_g``, ``b_x`` and ``b_y`` are the biases of gyro and accelerometer, ``s`` is the relative
error of the wheel radii, and ``o`` the offset of the twist's yaw rate. At the point ``p``, the
specific force ``f`` gives the change of the velocity without the angular acceleration:

    u' = R(-Omega dt) u + R(-Omega dt / 2) (f - b) dt

where ``u'`` is the velocity after a step ``dt``, ``R(a)`` the rotation by an angle ``a``, ``b`` the
bias ``(b_x, b_y)``, and ``k`` the unit vector upwards. Without an accelerometer the velocity is
modeled as a random walk. The measurements are

    gyro           Omega + b_g
    twist          v = u - Omega k x p, Omega + o
    rolling wheel  roll omega = (1 + s) (n_w . u + (lever + n_wx p_y - n_wy p_x) Omega)

For a wheel with the active direction ``n_w``, ``omega`` is the wheel speed, ``roll`` the ratio of
the rim's speed along ``n_w`` to the wheel speed, and ``lever`` the lever arm of ``n_w`` about the
center of the wheels, to which the twist and the position ``p`` of the IMU also refer.

To make their likelihoods comparable, all hypotheses explain the same readings. A reading of a
faulty source is modeled as a random walk from the last reading, whose steps are as large as the
vehicle's motion allows, or as their mean square over the last 0.1 s, if this is larger. An error
that changes its sign at every reading has a mean of 0, but such a large mean square. In a stop, a
gyro reading that equals the last one, and wheel speeds that all do, contain no new information. A
wheel is modeled as a mixture of rolling, sliding, locked and a faulty encoder. The prior
probabilities of these cases depend on the state of the brake. The slip of a released wheel only
falls. A rim slows down no faster than its brake can stop it; this limit is used only with the law
`allocation`, whose configuration describes brakes and wheels. While the slip of a braked wheel
changes slowly, it falls at least by the same share as the torque of the brake. The probability of
each hypothesis, and the probabilities of faulty encoders under it, are updated by Bayes' rule with
a constant transition probability (Blom and Bar-Shalom 1988). These probabilities alone decide which
source is isolated and when it recovers.

The filter of the most probable hypothesis gives the estimate. The filter of all sources, and with
the pedal up every filter, follows it with a time constant, as in interacting multiple models. A
component of a fused twist replaces the same component of the estimate if it has a smaller variance.
No estimate exists in three cases: too many sources are faulty; the variance is too large; or the
twist is isolated, and the IMU gives no reading. All brakes then act; in the first and the third
case, they act until the pedal is released. Without an IMU, only the wheels can show that the twist
is faulty.

A reading that does not change for long is missing from then on. It was wrong before, and may have
isolated the twist: if the twist is isolated, or too many sources seem faulty, all filters are then
initialized again with the twist. This requires an IMU, because otherwise nothing else measures the
motion.

The filters run at the time of validity of the newest twist (delayed fusion horizon). With the
readings of gyro and accelerometer, the estimate is predicted from that time to the present.
"""
