"""Losses along the passive direction: rolling resistance, bearing friction, roller inertia.

Section 2.4.2 of the dissertation lists these losses and neglects them. In this project they are
zero by default. The roller in contact rolls along the passive direction ``u_w`` with the rim's
velocity in this direction,

    w = u_w . v_i - omega r_D (u_w . u_i)

Here the wheel has the velocity ``v_i``, the speed ``omega``, the rolling radius ``r_D`` and the
rolling direction ``u_i``. If a wheel with a roller angle of 0 deg moves in its rolling direction,
or if the wheels of a Mecanum platform roll straight ahead, no roller turns and there are no losses.
The force ``f`` along ``u_w`` acts on the vehicle at the wheel, and the torque ``-r_D (u_w . u_i)
f`` acts on the spin of the wheel:

    f = -(f_r + f_b + f_2 w^2 + C F_z / D sqrt(h_t / w_t)) F_z sign(w) - m_r / 2 dw/dt

``F_z`` is the wheel load and ``m_r`` the mass of the roller. ``f_r`` and ``f_b`` are the constant
ratios of rolling resistance and bearing friction to the load, and ``f_2`` is the growth of this
ratio with the square of the speed, to which section 2.4.2 refers. The remaining symbols belong to
the part of Eq. (19) that grows with the load: ``C`` is the elasticity of the tread, ``D`` the
diameter of the roller, and ``h_t`` and ``w_t`` are the height and the width of the tread. Rolling
resistance and bearing friction hold a roller at rest up to the same force. The roller is a solid
cylinder, ``I = m_r r^2 / 2``, so its radius does not matter. The model neglects the acceleration of
a roller that comes into contact, and the rolling resistance of the wheel as a whole. Individual
rollers (`vehicle.roller_dynamics`) have their own inertia, and each loaded roller has the same
resistance.
"""

from omni_core.kernels import lean
from omni_sim.wheel.configuration import PassiveLossConfiguration  # noqa: F401 - earlier names


@lean
def passive_force(
    coming: float,
    now: float,
    before: float,
    mobility: float,
    capacity: float,
    inertia: float,
    dt: float,
) -> float:
    """Return the force of one roller on the vehicle along the passive direction [N].

    The force depends implicitly on the roller's speed at the end of the step, so that friction can
    hold the roller at rest.

    Args:
        coming: surface speed that the roller would have at the end of this step with the forces of
            the last step [m/s].
        now: surface speed of the roller at the start of the step [m/s].
        before: force in the last step [N].
        mobility: change of the surface speed per force [m/s per N].
        capacity: limit on the sum of rolling resistance and bearing friction [N].
        inertia: moment of inertia of the roller divided by its squared radius [kg].
        dt: length of the step [s].
    """
    rate = inertia / dt
    gain = 1.0 + mobility * rate
    free = (coming - mobility * before + mobility * rate * now) / gain
    friction = min(max(-free * gain / mobility, -capacity), capacity)
    speed = free + mobility * friction / gain
    return friction - rate * (speed - now)
