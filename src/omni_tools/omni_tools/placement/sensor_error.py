"""Error of one line camera as a function of its direction of motion: a model with two parameters.

If a camera moves along its axis, its error is caused by the noise of its lines. If it moves across
its axis, a share ``q = |v_across| / (line rate * width)`` of the ground under a line is replaced
between one line and the next. The replaced ground acts as noise with the contrast of the texture.
Noise and replaced ground contribute to the difference of two lines. Gauss-Newton steps divide this
difference by the gradient energy of the part that the lines have in common. This part is ``(1 - q)
(1 - p)`` with ``p = |v_along| / (line rate * length)``. The variance of the velocity is

    s^2 = (a + b q f) / ((1 - q)^2 (1 - p)),

where ``1 - p`` enters once, by the sum over the line, and ``1 - q`` twice, by the mean over the
width. Every strip of ground contributes the same error twice: when it enters the field of view and
when it leaves it. Over m pairs of lines, the entering and leaving strips differ if ``m q < 1`` and
are mostly the same if ``m q > 1``, so ``f = max(1, 2 - 1 / (m q))``.

The values of a and b for the mean over a batch depend on ground, noise, optics and filters. Both
are therefore fitted: a camera of this type moves over a ground in several directions,
`SensorOdometry` processes its rendered lines, and the model is fitted to the errors.
"""

import itertools
import math
import statistics
from typing import NamedTuple

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.sensor import SensorOdometry
from omni_core.configuration import WorkError
from omni_core.quantities import SECOND_NS, FloatArray
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import PERIOD, Rig, View, batch_lines

ORIENTATIONS = 24
"""Number of random orientations of the camera on the ground for each direction of motion. With a
single orientation, the 0.2 m of texture would cause an error that is equal in all trials."""

_CAMERA = "camera"
_ANGLES = (0.0, 3.0, 10.0, 20.0, 35.0, 50.0, 70.0, 90.0)  # from camera axis to motion [deg]


class SensorError(NamedTuple):
    """Error model of a camera: variance of the mean velocity along its axis over a batch.

    Attributes:
        straight: a, variance if the camera moves along its axis [m^2/s^2].
        sideways: b, factor of the replaced ground ``q f`` in the numerator of the variance
            [m^2/s^2].
    """

    straight: float
    sideways: float

    def variance(self, view: View, along: FloatArray, across: FloatArray) -> FloatArray:
        """Return the variance of the measured velocity [m^2/s^2]; infinite if lines do not overlap.

        Args:
            view: field of view of the camera.
            along: velocity of the camera along its axis [m/s], any shape.
            across: velocity of the camera across its axis [m/s], same shape.
        """
        q = np.abs(across) / (view.line_rate * view.width)
        p = np.abs(along) / (view.line_rate * view.length)
        common = np.maximum(1.0 - q, 0.0) ** 2 * np.maximum(1.0 - p, 0.0)
        # q f, which equals q while m q < 1
        crossed = np.maximum(q, 2.0 * q - 1.0 / batch_lines(view.line_rate))
        with np.errstate(divide="ignore"):
            return np.asarray((self.straight + self.sideways * crossed) / common)


class SensorTrial(NamedTuple):
    """Errors of one camera type over a ground in A motions, and the fitted model.

    Attributes:
        error: the fitted model.
        along: velocity along the axis [m/s], shape (A,).
        across: velocity across the axis [m/s], shape (A,).
        rms: RMS error of the measured velocity [m/s], shape (A,).
        fitted: RMS error according to the fitted model [m/s], shape (A,).
    """

    error: SensorError
    along: FloatArray
    across: FloatArray
    rms: FloatArray
    fitted: FloatArray

    @property
    def misfit(self) -> float:
        """Relative difference between fitted and measured errors, RMS over all motions [1]."""
        return math.expm1(float(np.sqrt(np.mean(np.log(self.fitted / self.rms) ** 2))))


def measure_sensor_error(
    view: View,
    texture: GroundTexture,
    noise: float,
    speed: float,
    batches: int,
    seed: int,
    spread: float = 0.02,
) -> SensorTrial:
    """Simulate a camera in several directions over a ground, and fit the model to the errors.

    Args:
        view: field of view of the camera.
        texture: the ground.
        noise: standard deviation [gray levels of 8 bit].
        speed: speed of the camera [m/s], at most its `LineSensor.sideways_speed`.
        batches: number of batches of lines for each direction and orientation.
        seed: seed of positions, speeds and noise.
        spread: random variation of speed [1] and direction [rad], so that displacements include all
            fractions of a pixel.

    Raises:
        WorkError: the camera cannot measure one of these motions on this ground.
    """
    generator = np.random.default_rng(seed)
    rig = Rig({_CAMERA: view.mounted()}, texture, noise, seed)
    odometry = _odometry(view)
    pairs = batch_lines(view.line_rate)
    # The stamps are far apart, so that lines of different batches are not compared.
    stamps = itertools.count(0, 4 * round(SECOND_NS * pairs / view.line_rate))
    batch = {_CAMERA: np.arange(pairs + 1)}
    rows = []
    for angle in np.radians(_ANGLES):
        errors, reasons = [], []
        for yaw in np.repeat(generator.uniform(0.0, math.tau, ORIENTATIONS), batches):
            v = speed * (1.0 + spread * generator.uniform(-1.0, 1.0))
            turned = angle + spread * generator.uniform(-1.0, 1.0)
            twist = np.array([v * math.cos(turned), v * math.sin(turned), 0.0])
            start = np.append(generator.uniform(0.0, PERIOD, 2), yaw)
            reading = odometry.update(rig.expose(start, twist, batch, next(stamps))[_CAMERA])
            if reading.measured:
                errors.append(reading.velocity - twist[0])
            else:
                reasons.append(reading.reason)
        trials = ORIENTATIONS * batches
        if len(errors) < 0.5 * trials:
            reason = _most_frequent(reasons)
            option, advice = _remedy(reason, view.overlap(speed, float(angle)), noise)
            raise WorkError(
                f"{option}: moving at {math.degrees(angle):.0f} deg to its axis at {speed:.3g} m/s "
                f"the camera measures in only {len(errors)} of {trials} trials on this ground, "
                f'mostly for reasons such as "{reason}"; choose {advice}'
            )
        rms = math.sqrt(float(np.mean(np.square(errors))))
        rows.append((speed * math.cos(angle), speed * math.sin(angle), rms))
    along, across, rms = np.array(rows).T
    error = _fit(view, along, across, rms)
    return SensorTrial(error, along, across, rms, np.sqrt(error.variance(view, along, across)))


def _odometry(view: View) -> SensorOdometry:
    # Only the first camera is used; the others make the placement non-singular.
    left, right = view.mounted(0.0, 0.5), view.mounted(0.0, -0.5)
    sensors = {"left": left, "right": right, "front": view.mounted(0.5, 0.0, 90.0)}
    return SensorOdometry(left, OdometryConfiguration(sensors=sensors))


def _most_frequent(reasons: list[str]) -> str:
    """Return one of the most frequent reasons; texts that agree up to the colon count as equal."""
    kind = statistics.mode(reason.partition(":")[0] for reason in reasons)
    return next(reason for reason in reasons if reason.partition(":")[0] == kind)


def _remedy(reason: str, overlap: float, noise: float) -> tuple[str, str]:
    """Return the option that causes the rejection of batches, and a remedy.

    Args:
        reason: reason of the rejection.
        overlap: overlap of consecutive lines, 0 to 1.
        noise: standard deviation of the noise [gray levels].
    """
    if reason.startswith("frozen"):  # impossible with the noise of a real camera
        return "--noise", "more --noise or a higher --speed, so that the lines change"
    choices = ["another --ground", "another --type"]
    if overlap < 0.9:  # at a larger overlap, a lower speed helps little
        choices.append("a lower --speed")
    if noise > 0.0:
        choices.append("less --noise")
    return "--ground", ", ".join(choices[:-1]) + " or " + choices[-1]


def _fit(view: View, along: FloatArray, across: FloatArray, rms: FloatArray) -> SensorError:
    """Return the error model, fitted to the logarithms of the errors.

    The logarithms give the relative errors of all motions equal weights.

    Args:
        view: field of view of the camera.
        along: velocity along the axis in A motions [m/s], shape (A,).
        across: velocity across the axis [m/s], shape (A,).
        rms: measured RMS error of the velocity [m/s], shape (A,).
    """
    from scipy.optimize import least_squares

    straight = float(rms[np.argmin(across)]) ** 2
    crossed = float(np.max(across)) / (view.line_rate * view.width)
    sideways = max(float(np.max(rms)) ** 2 - straight, straight) * (1.0 - crossed) ** 2 / crossed

    def difference(logarithms: FloatArray) -> FloatArray:
        error = SensorError(*np.exp(logarithms).tolist())
        return np.log(error.variance(view, along, across)) - 2.0 * np.log(rms)

    fit = least_squares(difference, np.log([straight, sideways]))
    return SensorError(*np.exp(fit.x).tolist())
