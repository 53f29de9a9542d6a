"""Error of one line camera over the direction of its motion: a model with two fitted parameters.

Moving along its axis, the error of a camera is due to the noise of its lines. Moving across it, a
share ``q = |v_across| / (line rate * width)`` of the ground under a line is replaced from one line
to the next, and the replaced ground acts as noise with the contrast of the texture. Both add to the
difference of two lines, which Gauss-Newton divides by the gradient energy of what the lines have in
common, ``(1 - q) (1 - p)`` of it with ``p = |v_along| / (line rate * length)``:

    s^2 = (a + b q f) / ((1 - q)^2 (1 - p)),

where the sum over the line makes ``1 - p`` enter once and the mean over the width ``1 - q`` twice.
Every strip of ground contributes the same error twice: when it enters the view and when it leaves
it. In a mean over m pairs of lines these are different strips while ``m q < 1``, and mostly the
same ones beyond that, so that ``f = max(1, 2 - 1 / (m q))``.

The values of a and b for the mean over a batch depend on ground, noise, optics and filters. Hence
both are fitted: a camera of the type is moved over a ground at several angles, its rendered lines
are processed by the odometry's `SensorOdometry`, and the model is fitted to the errors.
"""

import collections
import dataclasses
import math

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.sensor import SensorOdometry
from omni_platform.configuration import ConfigurationError
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_platform.sensors import OVERLAP
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import PERIOD, Rig, View, batch_lines

MOST_CROSSED = 1.0 - OVERLAP
"""Largest displacement across the axis between lines as a share of the width (section 4.4)."""

ORIENTATIONS = 24
"""Random orientations on the ground of every motion: along a single one, 0.2 m of texture have an
error of their own that more trials do not average out."""

_CAMERA = "camera"
_ANGLES = (0.0, 3.0, 10.0, 20.0, 35.0, 50.0, 70.0, 90.0)  # of the motion from the axis [deg]


@dataclasses.dataclass(frozen=True)
class SensorError:
    """Variance of a camera's velocity along its axis, as a mean over a batch.

    Attributes:
        straight: a, when it moves along its axis [m^2/s^2].
        sideways: b, increase per share of the width that is crossed between lines [m^2/s^2], while
            a batch does not cross all of it.
    """

    straight: float
    sideways: float

    def variance(self, view: View, along: FloatArray, across: FloatArray) -> FloatArray:
        """Return the variance of the measured velocity [m^2/s^2]; infinite without overlap.

        Args:
            view: field of view of the camera.
            along: velocity of the camera along its axis [m/s].
            across: velocity across it [m/s], same shape.
        """
        q = np.abs(across) / (view.line_rate * view.width)
        p = np.abs(along) / (view.line_rate * view.length)
        common = np.maximum(1.0 - q, 0.0) ** 2 * np.maximum(1.0 - p, 0.0)
        # q f, which is q while m q < 1
        crossed = np.maximum(q, 2.0 * q - 1.0 / batch_lines(view.line_rate))
        with np.errstate(divide="ignore"):
            variance: FloatArray = (self.straight + self.sideways * crossed) / common
            return variance


@dataclasses.dataclass(frozen=True, eq=False)
class SensorTrial:
    """Errors of one camera type over a ground.

    Attributes:
        error: the fitted model.
        along: velocity along the axis [m/s], shape (A,).
        across: velocity across it [m/s], shape (A,).
        rms: error of the measured velocity [m/s], shape (A,).
        fitted: errors of the model [m/s], shape (A,).
    """

    error: SensorError
    along: FloatArray
    across: FloatArray
    rms: FloatArray
    fitted: FloatArray

    @property
    def misfit(self) -> float:
        """Typical ratio of modeled and measured errors, less 1 [1]."""
        return math.expm1(float(np.sqrt(np.mean(np.log(self.fitted / self.rms) ** 2))))


def sideways_limit(view: View) -> float:
    """Return the speed across the axis with 60 % overlap [m/s]."""
    return MOST_CROSSED * view.line_rate * view.width


def measure_sensor_error(
    view: View,
    texture: GroundTexture,
    noise: float,
    speed: float,
    batches: int,
    seed: int,
    spread: float = 0.02,
) -> SensorTrial:
    """Move a camera over a ground at several angles and fit the model to its errors.

    Args:
        view: field of view of the camera.
        texture: the ground.
        noise: standard deviation [gray levels of 8 bit].
        speed: speed of the camera [m/s], at most `sideways_limit`.
        batches: batches of lines, for each angle in each of `ORIENTATIONS`.
        seed: seed of positions, speeds and noise.
        spread: of speed [1] and angle [rad]: displacements take every fraction of a pixel.

    Raises:
        ConfigurationError: the camera does not see this motion over this ground.
    """
    generator = np.random.default_rng(seed)
    rig = Rig({_CAMERA: view.mounted()}, texture, noise, seed)
    odometry = _odometry(view)
    pairs = batch_lines(view.line_rate)
    duration_ns = round(SECOND_NS * pairs / view.line_rate)
    batch = {_CAMERA: np.arange(pairs + 1)}
    rows = []
    count = 0
    for angle in np.radians(_ANGLES):
        errors, reasons = [], []
        for yaw in np.repeat(generator.uniform(0.0, math.tau, ORIENTATIONS), batches):
            v = speed * (1.0 + spread * generator.uniform(-1.0, 1.0))
            turned = angle + spread * generator.uniform(-1.0, 1.0)
            twist = np.array([v * math.cos(turned), v * math.sin(turned), 0.0])
            start = np.append(generator.uniform(0.0, PERIOD, 2), yaw)
            # Stamps far apart: no line of a batch is compared with one of another.
            seen = rig.expose(start, twist, batch, 4 * count * duration_ns)
            reading = odometry.update(seen[_CAMERA])
            count += 1
            if reading.measured:
                errors.append(reading.velocity - twist[0])
            else:
                reasons.append(reading.reason)
        trials = ORIENTATIONS * batches
        if len(errors) < 0.5 * trials:
            reason = _most_frequent(reasons)
            option, advice = _remedy(reason, view.overlap(speed, float(angle)), noise)
            raise ConfigurationError(
                option,
                f"moving at {math.degrees(angle):.0f} deg to its axis at {speed:.3g} m/s the "
                f"camera measures in only {len(errors)} of {trials} trials on this ground, mostly "
                f'for reasons such as "{reason}"; choose {advice}',
            )
        rows.append((speed * math.cos(angle), speed * math.sin(angle), _rms(np.array(errors))))
    along, across, rms = np.array(rows).T
    error = _fit(view, along, across, rms)
    return SensorTrial(error, along, across, rms, np.sqrt(error.variance(view, along, across)))


def _odometry(view: View) -> SensorOdometry:
    # The places are any that are not singular: only one of the three is used.
    sensors = {
        name: view.mounted(x, y, heading)
        for name, x, y, heading in (
            ("left", 0.0, 0.5, 0.0),
            ("right", 0.0, -0.5, 0.0),
            ("front", 0.5, 0.0, 90.0),
        )
    }
    return SensorOdometry(sensors["left"], OdometryConfiguration(sensors=sensors))


def _most_frequent(reasons: list[str]) -> str:
    """Return a reason of the most frequent kind; the text before its numbers is its kind."""
    kinds = collections.Counter(reason.partition(":")[0] for reason in reasons)
    kind = kinds.most_common(1)[0][0]
    return next(reason for reason in reasons if reason.partition(":")[0] == kind)


def _remedy(reason: str, overlap: float, noise: float) -> tuple[str, str]:
    """Return the option that causes a reason of the odometry, and a remedy."""
    if reason.startswith("frozen"):  # which the noise of a real camera rules out
        return "--noise", "more --noise or a higher --speed, so that the lines change"
    choices = ["another --ground", "another --type"]
    if overlap < 0.9:  # beyond, a lower speed helps little
        choices.append("a lower --speed")
    if noise > 0.0:
        choices.append("less --noise")
    return "--ground", ", ".join(choices[:-1]) + " or " + choices[-1]


def _rms(error: FloatArray) -> float:
    return math.sqrt(float(np.mean(error**2)))


def _fit(view: View, along: FloatArray, across: FloatArray, rms: FloatArray) -> SensorError:
    """Fit a and b to the logarithms of the errors, so that all have the same relative weight."""
    from scipy.optimize import least_squares

    straight = float(rms[np.argmin(across)]) ** 2
    crossed = float(np.max(across)) / (view.line_rate * view.width)
    sideways = max(float(np.max(rms)) ** 2 - straight, straight) * (1.0 - crossed) ** 2 / crossed

    def difference(logarithms: FloatArray) -> FloatArray:
        error = SensorError(*(float(value) for value in np.exp(logarithms)))
        return np.log(error.variance(view, along, across)) - 2.0 * np.log(rms)

    fit = least_squares(difference, np.log([straight, sideways]))
    a, b = (float(value) for value in np.exp(fit.x))
    return SensorError(a, b)
