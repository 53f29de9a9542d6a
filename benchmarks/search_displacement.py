"""Measure the search for displacements: line pairs per second.

    python benchmarks/search_displacement.py [--json]

The benchmark prints medians over repeated batches of 25 lines, on one core. There are two rows for
each number n of pixels and each bit depth: the full search over shifts up to +/- n/2 by Pearson's
correlation, and this search with sub-pixel refinement. One row has the factor by which a window
about the last displacement speeds up the direct search. The last rows compare the speed of the full
search with two other methods over the same shifts: `scipy.spatial.distance.pdist`, called for every
shift, and OpenCV's `matchTemplate` without normalization, on one thread. For `matchTemplate`, a
batch contains the lines of a control period of 10 ms: 1024 px at 2500 lines/s, 335 px at 2985
lines/s (LIS-770i) or 128 px at 15600 lines/s (S3901). Without OpenCV this comparison is omitted.
Install OpenCV by

    ./omni install opencv
"""

import importlib
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import output
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from linescan_odometry.matching.search import METRICS, make_search
from linescan_odometry.matching.subpixel import SubpixelRefiner

cv2: Any
try:
    cv2 = importlib.import_module("cv2")
except ImportError:
    cv2 = None

LINES = 25
Lines = NDArray[np.uint8] | NDArray[np.uint16]


def record(pixels: int, lines: int, dtype: type) -> Lines:
    """Return noisy lines of a fine random ground, shape (lines, pixels).

    The field of view is 50 mm long, and the ground moves by 4 mm from line to line.
    """
    generator = np.random.default_rng(1)
    step = 4e-3 / (0.05 / pixels)
    grains = 4 * int(step * lines + pixels + 4)
    integral = np.cumsum(generator.standard_normal(grains))
    edges = 4.0 * (step * np.arange(lines)[:, None] + np.arange(pixels + 1))
    profile = np.diff(np.interp(edges, np.arange(grains), integral))
    levels = 128.0 + 30.0 * profile / profile.std() + 2.0 * generator.standard_normal(profile.shape)
    scale = np.iinfo(dtype).max / 255.0
    exposed: Lines = np.clip(np.rint(levels * scale), 0, np.iinfo(dtype).max).astype(dtype)
    return exposed


def median_times(repetitions: int, *actions: Callable[[], object]) -> list[float]:
    """Run the actions in turns; return the median duration of each, ignoring the first turn [s]."""
    durations = []
    for _ in range(repetitions + 1):
        times = [time.perf_counter()]
        for action in actions:
            action()
            times.append(time.perf_counter())
        durations.append(np.diff(times))
    return [statistics.median(column) for column in zip(*durations[1:], strict=True)]


def measure(repetitions: int) -> output.Metrics:
    """Return all metrics, keyed by name."""
    metrics: output.Metrics = {}
    for dtype, bits in ((np.uint8, 8), (np.uint16, 16)):
        for pixels in (1024, 335, 128):
            lines = record(pixels, LINES + 1, dtype)
            shift = np.empty(LINES, np.int64)
            similarity = np.empty(LINES)
            search = METRICS["pearson"](pixels // 2)
            refiner = SubpixelRefiner(pixels)

            def both() -> None:
                search.match(lines, shift, similarity)  # noqa: B023
                refiner.refine(lines, shift)  # noqa: B023

            (alone,) = median_times(repetitions, lambda: search.match(lines, shift, similarity))  # noqa: B023
            case = f"{pixels}px_{bits}bit"
            limit = (60e3,) if (pixels, bits) == (1024, 8) else ()
            metrics[f"search_rate.{case}"] = LINES / alone, "1/s", *limit
            (refined,) = median_times(repetitions, both)
            metrics[f"displacement_rate.{case}"] = LINES / refined, "1/s"
    metrics |= compared_with_window(repetitions)
    metrics |= compared_with_pdist(repetitions)
    metrics |= compared_with_opencv(repetitions)
    return metrics


def compared_with_window(repetitions: int, window: int = 16) -> output.Metrics:
    """Return by which factor a window about the last displacement speeds up the direct search.

    Args:
        repetitions: number of repetitions.
        window: half width of the window [px].
    """
    lines, limit = record(1024, LINES + 1, np.uint8), 512
    shift, similarity = np.empty(LINES, np.int64), np.empty(LINES)
    every, near = (make_search("manhattan", limit, width) for width in (0, window))
    slow, fast = median_times(
        repetitions,
        lambda: every.match(lines, shift, similarity),
        lambda: near.match(lines, shift, similarity),
    )
    return {"window_speedup.1024px": (slow / fast, "1", 2.0)}


def compared_with_pdist(repetitions: int) -> output.Metrics:
    """Return the speed of the full search relative to `pdist`."""
    metrics: output.Metrics = {}
    shift, similarity = np.empty(LINES, np.int64), np.empty(LINES)
    for pixels in (1024, 335, 128):
        lines = record(pixels, LINES + 1, np.uint8)
        full = METRICS["pearson"](pixels // 2)
        (direct,) = median_times(3, lambda: pdist_search(lines[0], lines[1]))  # noqa: B023
        (fast,) = median_times(repetitions, lambda: full.match(lines, shift, similarity))  # noqa: B023
        metrics[f"ratio_to_pdist.{pixels}px"] = LINES * direct / fast, "1", 1000.0
    return metrics


def compared_with_opencv(repetitions: int) -> output.Metrics:
    """Return the speed of the full search relative to OpenCV."""
    if cv2 is None:
        print("no OpenCV: ratio_to_match_template is left out", file=sys.stderr)
        return {}
    cv2.setNumThreads(1)
    metrics: output.Metrics = {}
    for pixels, count, limit in ((1024, 25, 2.5), (335, 30, 5.0), (128, 156, 5.0)):
        lines = record(pixels, count + 1, np.uint8)
        own = METRICS["pearson"](pixels // 2)
        # The older line gets n/2 black pixels at each end, so that all shifts are covered.
        exact = lines.astype(np.float32)  # OpenCV is faster with floats than with integers
        padded = np.pad(exact, ((0, 0), (pixels // 2, pixels // 2)))
        shift, similarity = np.empty(count, int), np.empty(count)

        def theirs() -> None:
            for i in range(len(shift)):  # noqa: B023
                older, newer = padded[i : i + 1], exact[i + 1 : i + 2]  # noqa: B023
                cv2.minMaxLoc(cv2.matchTemplate(older, newer, cv2.TM_CCORR))

        fast, slow = median_times(
            repetitions,
            lambda: own.match(lines, shift, similarity),  # noqa: B023
            theirs,
        )
        metrics[f"ratio_to_match_template.{pixels}px"] = slow / fast, "1", limit
    return metrics


def pdist_search(old: NDArray[np.uint8], new: NDArray[np.uint8]) -> int:
    """Return the shift of the largest correlation, found by the method of the dissertation."""
    n = len(new)
    distances = [
        pdist(
            np.stack((new[max(0, -s) : n - max(0, s)], old[max(0, s) : n + min(0, s)])),
            "correlation",
        )[0]
        for s in range(-(n // 2), n // 2 + 1)
    ]
    return int(np.argmin(distances)) - n // 2


def main() -> None:
    """Measure and print."""
    options = output.options(__doc__, repetitions=200)
    output.publish("search_displacement", measure(options.repetitions), as_json=options.json)


if __name__ == "__main__":
    main()
