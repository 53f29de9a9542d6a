"""Looks at the cores in an environment into which pip has installed them and nothing else."""

import importlib
import pkgutil
import sys

CORES = ("omni_core", "linescan_odometry", "omni_brake_assist", "omni_sim")


def import_all() -> int:
    """Import every module of the cores but nodes, messages and old names; return how many."""
    count = 0
    for core in CORES:
        package = importlib.import_module(core)
        for module in pkgutil.walk_packages(package.__path__, core + "."):
            last = module.name.rpartition(".")[2]
            if module.name == "linescan_odometry.camera":  # old name of a module of omni_vehicle
                continue
            if not (last.endswith("_node") or last == "messages"):
                importlib.import_module(module.name)
                count += 1
    assert "rclpy" not in sys.modules
    return count


def measure() -> None:
    """Measure a motion of 1 m/s by three cameras."""
    import numpy as np

    from linescan_odometry.odometry import LineBatch, LineScanOdometry, OdometryConfiguration
    from omni_core.sensors import LineSensor

    def camera(x: float, y: float, heading_deg: float) -> LineSensor:
        view = {"pixels": 256, "length": 0.256, "width": 0.002, "line_rate": 1000.0}
        return LineSensor(x=x, y=y, heading_deg=heading_deg, **view)  # type: ignore[arg-type]

    sensors = {
        "left": camera(0.0, 0.2, 0.0),
        "right": camera(0.0, -0.2, 0.0),
        "front": camera(0.3, 0.0, 90.0),
    }
    grains = np.random.default_rng(0).integers(0, 255, (400, 256)).astype(float)
    rolled = [np.roll(grains, (i, j), (0, 1)) for i in range(4) for j in range(4)]
    ground = np.mean(rolled, axis=0)
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    for batch in range(4):
        rows = range(10 * batch, 10 * batch + 10)  # 1 mm per line along x: 1 m/s
        along = np.array([ground[row : row + 256, 20] for row in rows]).astype(np.uint8)
        across = np.array([ground[row] for row in rows]).astype(np.uint8)
        views = {"left": along, "right": along, "front": across}
        stamp_ns = 10_000_000 * (batch + 1)
        estimate = odometry.update(
            {name: LineBatch(stamp_ns, seen) for name, seen in views.items()}
        )
    assert estimate.measured, estimate.reason
    assert np.all(np.abs(estimate.twist - (1.0, 0.0, 0.0)) < (0.02, 0.5, 0.1)), estimate.twist


if __name__ == "__main__":
    print(import_all())
    measure()
