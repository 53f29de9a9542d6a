"""Fault detection and isolation by a bank of hypotheses (multiple-model estimation).

Each hypothesis says which sources are at fault: none, the twist, the gyro, the accelerometer, the
whole IMU, or too many. All but the last have an extended Kalman filter without these sources on the
state ``(u_x, u_y, Omega, b_g, b_x, b_y, s, o)``: velocity ``u = v + Omega k x p`` of the mounting
``p`` of the IMU in the body frame, yaw rate, biases of gyro and accelerometer, relative error of
the wheel radii, offset of the yaw rate of the twist. At the mounting the specific force ``f`` needs
no angular acceleration,

    u' = R(-Omega dt) u + R(-Omega dt / 2) (f - b) dt

and without an accelerometer the velocity is a random walk. The measurements are

    gyro           Omega + b_g
    twist          v = u - Omega k x p, Omega + o
    rolling wheel  R omega n_w . u_w = (1 + s) (n_w . u + (lever + n_wx p_y - n_wy p_x) Omega)

Each hypothesis explains all readings, so that their likelihoods compare: a reading of a source at
fault is a random walk from its last one, by as much as a vehicle can move. A wheel is a mixture of
rolling, sliding, and a faulty encoder, whose prior probabilities follow from its brake. Braking
takes speed from the vehicle, within the limits of the tires. The probabilities of the hypotheses
follow by Bayes' rule with one probability of transition (Blom and Bar-Shalom 1988), and so does
that of a faulty encoder; isolation, recovery and hysteresis follow from these.

The estimate is that of the most probable hypothesis; components of a fused twist that are less
uncertain replace it. There is none if too many sources are at fault, if its variance is too large,
or without the twist unless there are an IMU and a wheel that rolls; all brakes then act until the
pedal is released. Without an IMU, only wheels contradict the twist.

The filters are at the time of validity of the newest twist (delayed fusion horizon); the estimate
is predicted to the present by gyro and accelerometer.
"""
