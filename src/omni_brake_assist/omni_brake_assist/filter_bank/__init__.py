"""Fault detection and isolation by a bank of hypotheses (multiple-model estimation).

Each hypothesis states which sources are at fault: none, the twist, the gyro, the accelerometer, the
whole IMU, or too many. Each hypothesis but the last has an extended Kalman filter that does not use
these sources. Its state is ``(u_x, u_y, Omega, b_g, b_x, b_y, s, o)``: velocity
``u = v + Omega k x p`` of the mounting ``p`` of the IMU in the body frame, yaw rate, biases of gyro
and accelerometer, relative error of the wheel radii, offset of the yaw rate of the twist. At the
mounting, the specific force ``f`` gives the change of the velocity without the angular
acceleration,

    u' = R(-Omega dt) u + R(-Omega dt / 2) (f - b) dt

and without an accelerometer the velocity is a random walk. The measurements are

    gyro           Omega + b_g
    twist          v = u - Omega k x p, Omega + o
    rolling wheel  R omega n_w . u_w = (1 + s) (n_w . u + (lever + n_wx p_y - n_wy p_x) Omega)

Each hypothesis explains all readings, so that their likelihoods can be compared. A reading of a
source at fault is modeled as a random walk from its last reading, whose steps are as large as a
vehicle can move. A wheel is a mixture of rolling, sliding, and a faulty encoder, whose prior
probabilities follow from its brake. Braking reduces the speed, within the limits of the tires. The
probabilities of the hypotheses and of faulty encoders follow by Bayes' rule with one probability of
transition (Blom and Bar-Shalom 1988). These probabilities decide isolation, recovery and
hysteresis.

The estimate is that of the most probable hypothesis; components of a fused twist that are less
uncertain replace those of the filter. There is no estimate if too many sources are at fault, if the
variance is too large, or if the twist is missing and there is no IMU or no rolling wheel. All
brakes then act until the pedal is released. Without an IMU, only wheels can contradict the twist.

The filters are kept at the time of validity of the newest twist (delayed fusion horizon). Gyro and
accelerometer predict the estimate from there to the present.
"""
