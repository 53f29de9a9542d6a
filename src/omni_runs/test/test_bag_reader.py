"""A recorded run is read back bit for bit, and other recordings are rejected with a sentence."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_histories import first_difference
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from omni_recording.error import BagError
from omni_runs.history import RunHistory, quaternion_from_yaw
from omni_runs.metrics import run_metrics
from omni_runs.recorded_run import read_run

MakeHistory = Callable[..., RunHistory]
STORE = get_typestore(Stores.ROS2_JAZZY)
LINE_PERIOD_NS = 400_000


def message(kind: str, **fields: Any) -> Any:
    return STORE.types[kind](**fields)


def header(stamp_ns: int) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    stamp = message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return message("std_msgs/msg/Header", stamp=stamp, frame_id="base_link")


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def joints(stamp_ns: int, names: tuple[str, ...], **fields: Any) -> Any:
    values = {"position": [], "velocity": [], "effort": [], **fields}
    arrays = {name: np.array(value, dtype=np.float64) for name, value in values.items()}
    return message(
        "sensor_msgs/msg/JointState", header=header(stamp_ns), name=list(names), **arrays
    )


def planar(values: Any) -> Any:
    v_x, v_y, yaw_rate = (float(value) for value in values)
    return message("geometry_msgs/msg/Twist", linear=vector(v_x, v_y), angular=vector(z=yaw_rate))


def covariance(variances: Any) -> Any:
    matrix = np.zeros((6, 6))
    matrix[[0, 1, 5], [0, 1, 5]] = variances
    return matrix.ravel()


def recorded(run: RunHistory) -> RunHistory:
    """Return a run as its recording contains it, with each heading as a quaternion."""
    return RunHistory.from_samples(**vars(run))


def odometry(run: RunHistory, k: int) -> Any:
    x, y, _ = run.pose[k].tolist()
    q_z, q_w = quaternion_from_yaw(float(run.pose[k, 2]))
    pose = message(
        "geometry_msgs/msg/Pose",
        position=message("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=q_z, w=q_w),
    )
    blank = np.zeros(36)
    return message(
        "nav_msgs/msg/Odometry",
        header=header(int(run.stamp_ns[k])),
        child_frame_id="base_link",
        pose=message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=blank),
        twist=message(
            "geometry_msgs/msg/TwistWithCovariance", twist=planar(run.twist[k]), covariance=blank
        ),
    )


def estimate(run: RunHistory, k: int) -> Any:
    """Return the message of the odometry at row k of a run.

    Its stamp is that of its newest line. A twist that is NaN in the run is marked as unmeasured.
    """
    known = bool(run.measured[k])
    return message(
        "geometry_msgs/msg/TwistWithCovarianceStamped",
        header=header(max(int(run.stamp_ns[k]) - LINE_PERIOD_NS, 0)),
        twist=message(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=planar(run.estimate[k] if known else np.zeros(3)),
            covariance=covariance(run.estimate_variance[k] if known else np.full(3, 1e6)),
        ),
    )


def messages_of(run: RunHistory, k: int) -> dict[str, Any]:
    stamp, names = int(run.stamp_ns[k]), run.wheel_names
    return {
        "ground_truth/odom": odometry(run, k),
        "wheel_states": joints(
            stamp,
            names,
            position=run.wheel_angle[k],
            velocity=run.wheel_speed[k],
            effort=run.brake_torque[k],
        ),
        "brake/pedal": joints(stamp, ("brake_pedal",), position=[run.pedal[k]]),
        "brake/enable": joints(stamp, names, effort=run.enable[k]),
        "brake_assist/error": joints(stamp, names, velocity=run.error[k]),
        "odometry/twist": estimate(run, k),
    }


def write_bag(
    folder: Path,
    run: RunHistory,
    *,
    namespace: str = "",
    second: str = "",
    without: tuple[str, ...] = (),
    change: Callable[[str, int, Any], Any] = lambda _topic, _k, unchanged: unchanged,
) -> Path:
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        image_type = "sensor_msgs/msg/Image"
        images = writer.add_connection(
            f"{namespace}/line_scan/a/lines", image_type, typestore=STORE
        )
        connections: dict[str, Any] = {}
        if second:
            writer.add_connection(
                f"{second}/brake/enable", "sensor_msgs/msg/JointState", typestore=STORE
            )
        for k in range(len(run.stamp_ns)):
            # No decoder accepts these bytes, and the reader must not decode images.
            writer.write(images, int(run.stamp_ns[k]), b"\xff" * 50)
            for topic, original in messages_of(run, k).items():
                entry = change(topic, k, original)
                if topic in without or entry is None:
                    continue
                kind = entry.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(
                        f"{namespace}/{topic}", kind, typestore=STORE
                    )
                data = STORE.serialize_cdr(entry, kind)
                writer.write(connections[topic], int(run.stamp_ns[k]), data)
    return folder


@pytest.fixture
def run(make_history: MakeHistory) -> RunHistory:
    """Return a short run in which every array has different values."""
    plain = make_history(speed=1.0, brakes_at=0.1, deceleration=5.0, rest=0.1, turn=4.0)
    rng = np.random.default_rng(3)
    shape = plain.enable.shape
    varied = {
        name: rng.normal(size=shape)
        for name in ("wheel_angle", "wheel_speed", "brake_torque", "error")
    }
    measured = rng.normal(size=plain.twist.shape)
    measured[0] = np.nan
    return make_history(
        speed=1.0,
        brakes_at=0.1,
        deceleration=5.0,
        rest=0.1,
        turn=4.0,
        enable=rng.integers(0, 2, shape).astype(float),
        estimate=measured,
        estimate_variance=rng.uniform(1e-6, 1e-3, plain.twist.shape),
        **varied,
    )


@pytest.fixture
def bag(tmp_path: Path, run: RunHistory) -> Path:
    return write_bag(tmp_path / "assisted", run)


def test_a_run_survives_its_bag_to_the_bit(bag: Path, run: RunHistory) -> None:
    back = read_run(bag)
    assert first_difference(recorded(run), back) is None
    assert repr(run_metrics(back)) == repr(run_metrics(recorded(run)))


def test_wheels_without_angle_and_torque_are_read(tmp_path: Path, run: RunHistory) -> None:
    def speeds_alone(topic: str, _k: int, entry: Any) -> Any:
        if topic != "wheel_states":
            return entry
        nothing = np.zeros(0)
        return dataclasses.replace(entry, position=nothing, effort=nothing)

    back = read_run(write_bag(tmp_path / "bag", run, change=speeds_alone))
    np.testing.assert_array_equal(back.wheel_speed, run.wheel_speed)
    assert np.all(np.isnan(back.wheel_angle))
    assert np.all(np.isnan(back.brake_torque))


def test_the_motion_of_a_real_vehicle_is_its_integrated_twist(
    tmp_path: Path, make_history: MakeHistory
) -> None:
    plain = make_history(speed=1.0, brakes_at=0.1, deceleration=1.0, rest=0.2, turn=4.0)
    measured = plain.twist.copy()
    measured[3::7] = np.nan  # some samples are lost
    run = make_history(
        speed=1.0,
        brakes_at=0.1,
        deceleration=1.0,
        rest=0.2,
        turn=4.0,
        estimate=measured,
        estimate_variance=np.full(measured.shape, 1e-4),
    )
    back = run_metrics(read_run(write_bag(tmp_path / "bag", run, without=("ground_truth/odom",))))
    true = run_metrics(run)
    for quantity in ("stopping_distance", "orientation_change"):
        assert back[quantity].value == pytest.approx(true[quantity].value, rel=0.03), quantity
    assert np.isnan(back["twist_rmse"].value)


def test_topics_may_have_a_namespace(tmp_path: Path, run: RunHistory) -> None:
    bag = write_bag(tmp_path / "bag", run, namespace="/fleet/one")
    assert first_difference(recorded(run), read_run(bag)) is None


def test_two_vehicles_in_one_recording_are_no_run(tmp_path: Path, run: RunHistory) -> None:
    folder = write_bag(tmp_path / "bag", run, namespace="/one", second="/two")
    with pytest.raises(BagError, match=r"contains the vehicles /one, /two; `ros2 bag convert`"):
        read_run(folder)


def test_wheels_may_come_in_another_order(tmp_path: Path, run: RunHistory) -> None:
    def reversed_enable(topic: str, _k: int, entry: Any) -> Any:
        if topic == "brake/enable":
            entry.name.reverse()
            entry.effort = entry.effort[::-1].copy()
        return entry

    bag = write_bag(tmp_path / "bag", run, change=reversed_enable)
    assert first_difference(recorded(run), read_run(bag)) is None


def test_other_joints_are_not_wheels(tmp_path: Path, run: RunHistory) -> None:
    def with_an_arm(topic: str, _k: int, entry: Any) -> Any:
        if topic == "wheel_states":
            entry.name = ["arm_joint", *entry.name]
            for field in ("position", "velocity", "effort"):
                values = getattr(entry, field)
                if len(values):
                    setattr(entry, field, np.insert(values, 0, np.nan))
        return entry

    bag = write_bag(tmp_path / "bag", run, change=with_an_arm)
    assert first_difference(recorded(run), read_run(bag)) is None


def test_values_without_a_message_are_missing(tmp_path: Path, run: RunHistory) -> None:
    bag = write_bag(
        tmp_path / "bag",
        run,
        without=("brake_assist/error",),
        change=lambda topic, k, entry: None if topic == "brake/enable" and k == 7 else entry,
    )
    back = read_run(bag)
    assert np.all(np.isnan(back.error))
    assert np.flatnonzero(np.isnan(back.enable[:, 0])).tolist() == [7]


def test_the_pedal_stays_down_between_two_messages(tmp_path: Path, run: RunHistory) -> None:
    pressed = np.flatnonzero(run.pedal > 0.0)
    late = {*pressed[1::2].tolist()}
    bag = write_bag(
        tmp_path / "bag",
        run,
        change=lambda topic, k, entry: None if topic == "brake/pedal" and k in late else entry,
    )
    assert np.flatnonzero(read_run(bag).pedal > 0.0).tolist() == pressed.tolist()


@pytest.mark.parametrize("topic", ["wheel_states", "brake/pedal"])
def test_a_topic_that_every_run_has_is_missed(tmp_path: Path, run: RunHistory, topic: str) -> None:
    bag = write_bag(tmp_path / "bag", run, without=(topic,))
    with pytest.raises(BagError, match=f"lacks /{topic}$"):
        read_run(bag)


def test_a_recording_without_any_motion_is_refused(tmp_path: Path, run: RunHistory) -> None:
    bag = write_bag(tmp_path / "bag", run, without=("ground_truth/odom", "odometry/twist"))
    with pytest.raises(BagError, match="neither /ground_truth/odom nor a measured /odometry/twist"):
        read_run(bag)


def test_a_topic_of_another_type_is_refused(tmp_path: Path, run: RunHistory) -> None:
    def as_image(topic: str, k: int, entry: Any) -> Any:
        return estimate(run, k) if topic == "ground_truth/odom" else entry

    bag = write_bag(tmp_path / "bag", run, change=as_image)
    with pytest.raises(BagError, match=r"/ground_truth/odom is of type .*TwistWithCov.* must be"):
        read_run(bag)


def test_a_strange_wheel_is_refused(tmp_path: Path, run: RunHistory) -> None:
    def renamed(topic: str, k: int, entry: Any) -> Any:
        if topic == "brake/enable" and k == 5:
            entry.name[2] = "spare"
        return entry

    bag = write_bag(tmp_path / "bag", run, change=renamed)
    with pytest.raises(BagError, match="spare"):
        read_run(bag)


def test_two_runs_in_one_bag_are_refused(tmp_path: Path, run: RunHistory) -> None:
    def again(_topic: str, k: int, entry: Any) -> Any:
        entry.header = header(int(run.stamp_ns[k % 20]))
        return entry

    bag = write_bag(tmp_path / "bag", run, change=again)
    with pytest.raises(BagError, match="not the recording of a single run"):
        read_run(bag)


@pytest.mark.parametrize(
    ("stamp", "words"),
    [(0, "1 messages of /wheel_states have the stamp 0"), (6, "wheel_states have the same stamp")],
)
def test_a_stamp_that_is_missing_or_repeated_is_named(
    tmp_path: Path, run: RunHistory, stamp: int, words: str
) -> None:
    def restamped(topic: str, k: int, entry: Any) -> Any:
        if topic == "wheel_states" and k == 7:
            entry.header = header(int(run.stamp_ns[stamp]) if stamp else 0)
        return entry

    bag = write_bag(tmp_path / "bag", run, without=("ground_truth/odom",), change=restamped)
    with pytest.raises(BagError, match=words):
        read_run(bag)


def test_a_bag_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no such folder"):
        read_run(tmp_path / "nowhere")
    (tmp_path / "file").write_text("x")
    with pytest.raises(BagError, match="not a folder"):
        read_run(tmp_path / "file")
    with pytest.raises(BagError, match=r"no metadata\.yaml$"):
        read_run(tmp_path)
    (tmp_path / "bag.mcap").touch()
    with pytest.raises(BagError, match="bag recover"):
        read_run(tmp_path)
    (tmp_path / "assisted").mkdir()
    (tmp_path / "assisted/metadata.yaml").touch()
    with pytest.raises(BagError, match="one of the recordings in it: assisted"):
        read_run(tmp_path)


@pytest.mark.parametrize("text", ["", "[]", "a: [", "rosbag2_bagfile_information: 3", "\0"])
def test_foreign_metadata_is_refused(bag: Path, text: str) -> None:
    (bag / "metadata.yaml").write_text(text)
    with pytest.raises(BagError):
        read_run(bag)


def test_an_empty_or_missing_recording_is_refused(bag: Path) -> None:
    (path,) = bag.glob("*.mcap")
    path.write_bytes(b"")
    with pytest.raises(BagError, match=r"mcap is empty"):
        read_run(bag)
    path.unlink()
    with pytest.raises(BagError):
        read_run(bag)


def test_a_foreign_recording_is_refused(bag: Path) -> None:
    (path,) = bag.glob("*.mcap")
    path.write_bytes(b"SQLite format 3\0" * 100)
    with pytest.raises(BagError, match="not an MCAP file"):
        read_run(bag)


@pytest.mark.parametrize("share", [0.0001, 0.01, 0.3, 0.7, 0.99, 0.9999])
def test_a_cut_recording_is_refused(bag: Path, share: float) -> None:
    (path,) = bag.glob("*.mcap")
    whole = path.read_bytes()
    path.write_bytes(whole[: max(int(len(whole) * share), 1)])
    with pytest.raises(BagError, match="truncated"):
        read_run(bag)


def test_a_damaged_recording_never_ends_in_a_strange_error(bag: Path, tmp_path: Path) -> None:
    (path,) = bag.glob("*.mcap")
    whole = path.read_bytes()
    rng = np.random.default_rng(11)
    refusals = []
    for _ in range(60):
        damaged = bytearray(whole)
        # Length fields and indexes are at both ends, so both ends and the middle are damaged.
        place = int(len(whole) * rng.choice([0.02, 0.5, 0.98]) + rng.integers(-1000, 1000))
        damaged[place : place + 8] = rng.bytes(8)
        copy = tmp_path / "damaged"
        shutil.copytree(bag, copy, dirs_exist_ok=True)
        (copy / path.name).write_bytes(damaged)
        try:
            read_run(copy)
        except BagError as error:
            refusals.append(str(error))
    assert refusals
    assert not any("\n" in refusal for refusal in refusals)
