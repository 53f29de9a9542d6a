"""Checks of a tested node's messages; each check yields one sentence for each violation."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics, require_omni_wheels
from omni_core.quantities import SECOND_NS, BoolArray, FloatArray, IntArray
from omni_core.signals import upwards_problem
from omni_ros.messages import to_nanoseconds, twist_of
from omni_runs.recorded_run import read_run
from omni_tools.node_check.exchange_node import Answer, Exchange, Received


@dataclass(frozen=True)
class Contract:
    """Limits that the messages of a tested node must meet.

    Attributes:
        largest_age: limit on the age of the messages [s], keyed by kind of node. If a twist is
            older, the assistant rejects it; if an enable is older, the vehicle applies all brakes.
        least_rate: required rate of a simulator's messages [1/s], keyed by topic; a rate up to a
            tenth lower is tolerated.
        least_answered: minimum share of the inputs that the node must answer [1].
        warm_up: time after the start in which a node may load its kernels [s].
        silence: time after which an assistant without inputs must not release a brake [s].
        recovery: limit on the time from the end of a fault to the next valid answer [s].
        longest_gap: time without a message after which a simulator counts as silent [s].
        clock_error: limit on the median difference between a simulator's stamps and /clock [s].
        largest_variance: limit on all three variances of a measured twist [m^2/s^2, rad^2/s^2].
        speed_excess: relative tolerance r [1] and absolute tolerance a [m/s]. If rolling wheels
            show a speed v of the vehicle, the median velocity error of the twists must not exceed
            r v + a. No twist may exceed the highest v of the recording by more than r v + a.
        yaw_rate_ratio: lower and upper limit on the ratio of the twist's yaw rate to the IMU's [1].
        turning: root mean square of the IMU's yaw rate above which this ratio is checked [rad/s].
    """

    largest_age: Mapping[str, float]
    least_rate: Mapping[str, float]
    least_answered: float = 0.95
    warm_up: float = 0.5
    silence: float = 0.15
    recovery: float = 0.5
    longest_gap: float = 1.0
    clock_error: float = 0.05
    largest_variance: float = 1.0
    speed_excess: tuple[float, float] = (0.2, 0.5)
    yaw_rate_ratio: tuple[float, float] = (0.5, 2.0)
    turning: float = 0.1


CONTRACT = Contract(
    {"odometry": 0.1, "brake_assist": 0.05},
    {"wheel_states": 100.0, "pedal": 100.0, "twist": 50.0, "imu": 100.0},
)


def metrics(exchange: Exchange) -> dict[str, tuple[float, str]]:
    """Return metrics of a node's answers as pairs (value, unit), keyed by ``quantity.phase``.

    The metrics are the share of answered inputs, the 99th percentile of the answers' age, and the
    number of answers.
    """
    first = [one for one in exchange.answers if one.phase == "recorded"]
    sent = exchange.sent["recorded"]
    answered = len({one.stamp_ns for one in first} & set(sent)) / max(len(sent), 1)
    begun = _warmed_up(exchange)
    # A node may publish its last answer again while no input arrives.
    ages = {one.stamp_ns: one.age for one in reversed(first) if one.stamp_ns >= begun}
    age = float(np.percentile(list(ages.values()), 99)) if ages else 0.0
    return {
        "answered.recorded": (100.0 * answered, "%"),
        **({"age_p99.recorded": (1e3 * age, "ms")} if ages else {}),
        "answers.all": (len(exchange.answers), "1"),
    }


def common_breaches(exchange: Exchange, node: str, topic: str) -> Iterator[str]:
    """Yield violations in the answers of any tested node: publishers, rate, age and stamps.

    Args:
        exchange: sent inputs and received answers.
        node: kind of the node, ``odometry`` or ``brake_assist``.
        topic: topic of the answers.
    """
    yield from _publisher_breaches(topic, exchange.publishers)
    for path, why in exchange.incompatible:
        yield f"a subscription to {path} receives nothing: {why}"
    found = metrics(exchange)
    if found["answered.recorded"][0] < 100.0 * CONTRACT.least_answered:
        yield (
            f"{found['answered.recorded'][0]:.0f} % of the inputs were answered with their stamp; "
            f"at least {100.0 * CONTRACT.least_answered:.0f} % must be"
        )
    age, _ = found.get("age_p99.recorded", (0.0, "ms"))
    if age > 1e3 * CONTRACT.largest_age[node]:
        yield (
            f"1 % of the answers are older than {age:.0f} ms; the limit is "
            f"{1e3 * CONTRACT.largest_age[node]:.0f} ms"
        )
    yield from _gap_breaches(exchange, round(CONTRACT.largest_age[node] * SECOND_NS))
    stamps = [one.stamp_ns for one in exchange.answers]
    repeats = node == "brake_assist"  # an assistant without inputs repeats its last stamp
    for before, after in itertools.pairwise(stamps):
        if after < before or (after == before and not repeats):
            pair = f"from {before / SECOND_NS:.3f} to {after / SECOND_NS:.3f} s"
            yield f"stamps do not increase, {pair}"
            break
    newest = max(max(sent) for sent in exchange.sent.values() if sent)
    if stamps and max(stamps) > newest:
        yield "a stamp is later than that of the newest input"


def enable_breaches(exchange: Exchange, wheels: Sequence[str]) -> Iterator[str]:
    """Yield violations of the contract by the enables that a brake assistant publishes."""
    for one in exchange.answers:
        if sorted(one.message.name) != sorted(wheels):
            yield f"brake/enable names {', '.join(one.message.name)}; must be {', '.join(wheels)}"
            break
    for one in exchange.answers:
        values = np.asarray(one.message.effort, dtype=np.float64)
        if len(values) != len(wheels) or not np.all((values >= 0.0) & (values <= 1.0)):
            yield f"effort {values.tolist()} in phase {one.phase!r}: one share of 0 to 1 per wheel"
            break
        if not np.any(values):
            yield f"all brakes are released at once (phase {one.phase!r}); one must stay applied"
            break
    for one in exchange.answers:
        late = one.phase == "silence" and one.silence > CONTRACT.silence
        if late and np.any(np.asarray(one.message.effort) < 1.0):
            yield (
                f"a brake is released {one.silence:.2f} s after the last input; without inputs all "
                "brakes must be on"
            )
            break
    for phase in ("gap", "unusable"):
        if not any(_after(exchange, phase)):
            yield f"no enables later than {_recovery(phase)}"


def twist_breaches(exchange: Exchange, motion: "WheelMotion") -> Iterator[str]:
    """Yield violations of the contract by the twists that an odometry node publishes.

    Args:
        exchange: sent inputs and received answers.
        motion: motion of the vehicle in the recording.
    """
    share, amount = CONTRACT.speed_excess
    for one in exchange.answers:
        speed = float(np.hypot(*twist_of(one.message).value[:2]))
        if _is_measured(one.message) and speed > (1.0 + share) * motion.fastest + amount:
            yield (
                f"speed {speed:.2f} m/s (phase {one.phase!r}, stamp "
                f"{one.stamp_ns / SECOND_NS:.3f} s), although the wheels of the recording reach "
                f"{motion.fastest:.2f} m/s"
            )
            break
    yield from motion.difference(
        [one for one in exchange.answers if one.phase == "recorded" and _is_measured(one.message)]
    )
    for one in exchange.answers:
        problem = _twist_problem(one.message)
        if problem:
            yield f"{problem} (phase {one.phase!r}, stamp {one.stamp_ns / SECOND_NS:.3f} s)"
            break
    if not any(_is_measured(one.message) for one in exchange.answers if one.phase == "recorded"):
        largest = CONTRACT.largest_variance
        yield (
            f"no twist has a variance below {largest:g} m^2/s^2: nothing is measured; start the "
            "node with the sensors of the recording"
        )
        return
    for phase in ("gap", "unusable"):
        if not any(_is_measured(one.message) for one in _after(exchange, phase)):
            yield f"no valid twist later than {_recovery(phase)}"


class WheelMotion(NamedTuple):
    """Motion of a recorded vehicle, computed from its wheel speeds, at T times.

    Attributes:
        stamp_ns: stamps of the wheel speeds [ns], shape (T,).
        velocity: velocity v_x, v_y of the vehicle if no wheel slips [m/s], shape (T, 2).
        rolling: whether the brake pedal is released, so that the wheels roll, shape (T,).
    """

    stamp_ns: IntArray
    velocity: FloatArray
    rolling: BoolArray

    @classmethod
    def of(cls, recording: Path, wheels: Mapping[str, WheelMount]) -> "WheelMotion":
        """Return the motion in a recording; `wheels` are the vehicle's wheels, keyed by name."""
        run = read_run(recording)
        ordered = {name: wheels[name] for name in run.wheel_names}
        require_omni_wheels(ordered, "check-node")
        twist = PlatformKinematics.of(ordered).twist(run.wheel_speed)
        return cls(run.stamp_ns, twist[:, :2], run.pedal == 0.0)

    @property
    def fastest(self) -> float:
        """Highest speed of the vehicle [m/s]."""
        return float(np.nanmax(np.hypot(*self.velocity.T)))

    def difference(self, answers: Sequence[Answer]) -> Iterator[str]:
        """Yield a violation if, while the wheels roll, most twists differ from this motion."""
        share, amount = CONTRACT.speed_excess
        at = np.searchsorted(self.stamp_ns, [one.stamp_ns for one in answers], side="right") - 1
        pairs = [
            (twist_of(one.message).value[:2], self.velocity[row])
            for one, row in zip(answers, at, strict=True)
            if row >= 0 and self.rolling[row]
        ]
        if not pairs:
            return
        measured, wheels = np.moveaxis(np.array(pairs), 1, 0)
        error, speed = (np.linalg.norm(one, axis=1) for one in (measured - wheels, wheels))
        if np.nanmedian(error / (share * speed + amount)) > 1.0:
            middle = int(np.argsort(error)[len(error) // 2])
            yield (
                f"velocity {np.round(measured[middle], 2)} m/s, although the wheels of the "
                f"recording roll at {np.round(wheels[middle], 2)} m/s"
            )


def simulator_breaches(seen: Mapping[str, Received], wheels: Sequence[str]) -> Iterator[str]:
    """Yield violations of the contract by the messages of a simulator.

    Args:
        seen: received messages from `enables_node.Enables.watch`, keyed by topic.
        wheels: names of the wheels.
    """
    if not seen["clock"].messages:
        yield "clock: nothing is published"
    for key in CONTRACT.least_rate:
        if key != "imu" or seen[key].messages:  # the IMU is optional
            yield from _stream_breaches(key, seen[key], seen["clock"])
    for _, message in seen["wheel_states"].messages:
        if sorted(message.name) != sorted(wheels):
            yield f"wheel_states names {', '.join(message.name)}; must be {', '.join(wheels)}"
            break
        if not np.all(np.isfinite(message.velocity)) or len(message.velocity) != len(wheels):
            yield "wheel_states: velocity must contain one finite number per wheel"
            break
    for _, message in seen["pedal"].messages:
        if not message.position or not 0.0 <= message.position[0] <= 1.0:
            yield f"brake/pedal: position {list(message.position)} must be one number, 0 to 1"
            break
    for _, message in seen["twist"].messages:
        problem = _twist_problem(message) if hasattr(message, "twist") else ""  # lines of a camera
        if problem:
            yield f"twist: {problem}"
            break
    forces = [(m.linear_acceleration, m.angular_velocity.z) for _, m in seen["imu"].messages]
    values = np.array([(force.x, force.y, force.z, yaw_rate) for force, yaw_rate in forces])
    if not np.all(np.isfinite(values)):
        yield "imu: yaw rate and specific force must be finite"
    elif forces:
        problem = ": ".join(upwards_problem(float(np.median(values[:, 2]))) or ())
        yield from filter(None, (problem, _yaw_rate_problem(seen)))


def _warmed_up(exchange: Exchange) -> int:
    """Return the stamp from which late or missing answers are violations [ns]."""
    return exchange.sent["recorded"][0] + round(CONTRACT.warm_up * SECOND_NS)


def _gap_breaches(exchange: Exchange, limit_ns: int) -> Iterator[str]:
    """Yield a violation if too many consecutive inputs are unanswered.

    Args:
        exchange: sent inputs and received answers.
        limit_ns: limit on the time between two answered inputs with unanswered inputs between
            them [ns].
    """
    begun = _warmed_up(exchange)
    sent = np.array([stamp for stamp in exchange.sent["recorded"] if stamp >= begun])
    first = [one for one in exchange.answers if one.phase == "recorded" and one.stamp_ns >= begun]
    answered = np.flatnonzero(np.isin(sent, [one.stamp_ns for one in first]))
    longest = max(
        (sent[b] - sent[a] for a, b in itertools.pairwise(answered) if b > a + 1), default=0
    )
    if longest >= limit_ns:
        yield (
            f"gap of {longest / 1e6:.0f} ms between two answers (inputs in between are "
            f"unanswered); the limit is {limit_ns / 1e6:.0f} ms"
        )


def _yaw_rate_problem(seen: Mapping[str, Received]) -> str:
    """Return a sentence if the yaw rates of twist and IMU disagree; otherwise an empty text."""
    imu = [message for _, message in seen["imu"].messages]
    twists = [message for _, message in seen["twist"].messages if _is_measured(message)]
    if not twists:
        return ""
    stamps, twist_stamps = (
        [to_nanoseconds(message.header.stamp) for message in messages] for messages in (imu, twists)
    )
    rates = np.interp(twist_stamps, stamps, [one.angular_velocity.z for one in imu])
    square = float(np.mean(rates**2))
    if square < CONTRACT.turning**2:
        return ""
    # The noise of the twist does not bias this ratio.
    ratio = float(np.mean(rates * [one.twist.twist.angular.z for one in twists])) / square
    least, most = CONTRACT.yaw_rate_ratio
    if least <= ratio <= most:
        return ""
    return (
        f"imu: the yaw rates of the twist are {ratio:.2g} times those of the IMU; check the units "
        "and signs of both"
    )


def _publisher_breaches(topic: str, publishers: Sequence[bool]) -> Iterator[str]:
    if len(publishers) > 1:
        yield f"{topic} has {len(publishers)} publishers; exactly one may publish it"
    if not all(publishers):
        yield f"{topic} is published with best effort, but its subscribers request reliable"


def _stream_breaches(key: str, received: Received, clock: Received) -> Iterator[str]:
    """Yield violations of the contract by the publishers and the messages of a topic.

    Args:
        key: name of the topic, a key of `Contract.least_rate`.
        received: messages of the topic.
        clock: messages of `/clock`.
    """
    if len(received.messages) < 2:
        yield f"{key}: fewer than two messages are published"
        return
    yield from _publisher_breaches(key, received.publishers)
    if received.silent:
        yield f"{key}: no message in the last {CONTRACT.longest_gap:g} s"
    published, messages = zip(*received.messages, strict=True)
    stamps = np.array([to_nanoseconds(message.header.stamp) for message in messages])
    if np.any(np.diff(stamps) <= 0):
        yield f"{key}: stamps do not increase"
    rate, least = (len(stamps) - 1) * SECOND_NS / max(np.ptp(stamps), 1), CONTRACT.least_rate[key]
    if rate < 0.9 * least:
        yield f"{key}: {rate:.0f} messages per second of its stamps, must be {least:.0f} or more"
    if not clock.messages:
        return
    ticks, clocks = zip(*clock.messages, strict=True)
    present = np.array([to_nanoseconds(message.clock) for message in clocks])
    newest = np.maximum(np.searchsorted(ticks, published, side="right") - 1, 0)
    ahead = float(np.median(stamps - present[newest])) / SECOND_NS
    if abs(ahead) > CONTRACT.clock_error:
        yield f"{key}: stamps differ from /clock by {ahead:+.2f} s"


def _after(exchange: Exchange, phase: str) -> list[Answer]:
    """Return the answers of a phase after its fault and the subsequent recovery time."""
    limit = exchange.faults[phase][1] + round(CONTRACT.recovery * SECOND_NS)
    return [one for one in exchange.answers if one.phase == phase and one.stamp_ns > limit]


def _recovery(phase: str) -> str:
    return f"{CONTRACT.recovery:g} s after a fault of one input ({phase})"


def _is_measured(message: Any) -> bool:
    """Return whether a message is a finite twist with a small variance."""
    if not hasattr(message, "twist"):  # lines of a camera
        return False
    _, twist, covariance, _ = twist_of(message)
    finite = bool(np.all(np.isfinite(twist)))
    return finite and bool(np.max(np.diag(covariance)) < CONTRACT.largest_variance)


def _twist_problem(message: Any) -> str:
    """Return a description of the violation in a twist; empty without a violation."""
    _, twist, covariance, _ = twist_of(message)
    if message.header.frame_id.rpartition("/")[2] != "base_link":
        return f"frame_id {message.header.frame_id!r} must be base_link"
    if not np.all(np.isfinite(twist)) or not np.all(np.isfinite(covariance)):
        return "twist and covariance must be finite; a variance of 1e6 stands for not measured"
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        return "the covariance is not positive definite; use 1e6 where nothing is measured"
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    if not np.all(np.abs(covariance - covariance.T) <= 1e-6 * scale):
        return "the covariance is not symmetric"
    return ""
