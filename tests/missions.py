"""A short mission with a sensor of every type, and mission folders written by hand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gtsam_nav.frames import Origin, rotation_from_rpy
from gtsam_nav.mission import Constraints, InitialState, LandmarkMap, Mission, Sensor
from gtsam_nav.series import (
    AttitudeSeries,
    BeamSeries,
    CloudSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    LandmarkSeries,
    OdometrySeries,
    ReferenceSeries,
    ScanSeries,
    Series,
)


def every_series(cloud_folder: Path, seed: int = 0, n: int = 12) -> dict[str, Series]:
    """One series of each type, over twelve seconds, with every optional column."""
    rng = np.random.default_rng(seed)

    def t() -> Any:
        return np.cumsum(rng.uniform(0.1, 1.0, n))

    def vectors(*shape: int) -> Any:
        return rng.normal(size=(n, *shape))

    def sigma(*shape: int) -> Any:
        return rng.uniform(0.01, 1.0, size=(n, *shape))

    clouds = []
    for k in range(3):
        cloud = cloud_folder / f"cloud_{seed}_{k}.npy"
        np.save(cloud, rng.normal(size=(5, 3)))
        clouds.append(cloud)
    return {
        "imu": ImuSeries(t=t(), gyro_i=vectors(3), accel_i=vectors(3)),
        "dvl": DvlSeries(
            t=t(),
            v_d=vectors(3),
            sigma=sigma(),
            valid=np.arange(n) % 5 != 3,
            bottom_lock=np.arange(n) % 4 != 2,
            altitude_m=sigma(),
        ),
        "odometry": OdometrySeries(
            t=t(), v_b=vectors(2), yaw_rate=vectors(), sigma_v=sigma(), sigma_yaw_rate=sigma()
        ),
        "gnss": GnssSeries(t=t(), p_n=100 * vectors(3), sigma=sigma(3), v_n=vectors(3)),
        "depth": DepthSeries(t=t(), depth_m=sigma(), sigma=sigma()),
        "heading": HeadingSeries(t=t(), heading=rng.uniform(-3, 3, n), sigma=sigma()),
        "attitude": AttitudeSeries(
            t=t(), roll=rng.uniform(-3, 3, n), pitch=rng.uniform(-1.5, 1.5, n), sigma=sigma()
        ),
        "landmarks": LandmarkSeries(
            t=np.repeat(np.arange(n // 2, dtype=float), 2),
            id=np.arange(n) - 1,
            range_m=sigma(),
            bearing=vectors(),
            elevation=vectors(),
            sigma_range=sigma(),
            sigma_bearing=sigma(),
        ),
        "beams": BeamSeries(
            t=t(),
            angle=rng.uniform(0, 6, n),
            intensity=rng.integers(0, 256, (n, 20), dtype=np.uint8),
            resolution_m=0.25,
        ),
        "scans": ScanSeries(
            t=np.arange(3.0), first=np.array([0, 4, 4, 9]), points_b=rng.normal(size=(9, 2))
        ),
        "clouds": CloudSeries(t=np.arange(3.0), clouds=tuple(clouds)),
        "reference": ReferenceSeries(
            t=t(),
            p_n=100 * vectors(3),
            rpy=rng.uniform(-1.5, 1.5, (n, 3)),
            sigma=sigma(),
            vertical_usable=False,
        ),
    }


def every_sensor_mission(cloud_folder: Path, seed: int = 0) -> Mission:
    """A mission with a sensor of every type, two of some, all mounted somewhere."""
    rng = np.random.default_rng(seed + 1)
    noise: dict[str, dict[str, Any]] = {
        "dvl": {"sigma_m_s": 0.02, "max_speed_m_s": 20.0},
        "beams": {"sigma_range_m": 0.2},
    }
    sensors = {}
    for name, series in every_series(cloud_folder, seed).items():
        body_axes = name in ("heading", "attitude", "reference")
        sensors[name] = Sensor(
            name=name,
            type=name,
            series=series,
            xyz_b=rng.normal(size=3),
            R_bs=np.eye(3) if body_axes else rotation_from_rpy(rng.uniform(-1.5, 1.5, 3)),
            noise=noise.get(name, {}),
            simulated=name == "beams",
        )
    spare = every_series(cloud_folder, seed + 7)["gnss"]
    sensors["stern / gnss"] = Sensor(name="stern / gnss", type="gnss", series=spare)
    return Mission(
        name="every sensor",
        sensors=sensors,
        origin=Origin(42.2, 3.1, 12.5),
        start_utc=1_700_000_000.25,
        initial=InitialState(np.array([1.0, -2.0, 0.5]), 2.5, -0.75, 0.125),
        landmark_map=LandmarkMap(np.array([3, 7]), rng.normal(size=(2, 3)), np.array([0.1, 0.2])),
        constraints=Constraints(nonholonomic=True),
    )


DEPTH_CSV = "t,depth_m,sigma\n" + "".join(f"{k},{1 + k / 10},0.1\n" for k in range(10))


def make_folder(
    folder: Path, files: Mapping[str, str | bytes], sensors: Mapping[str, Any], **description: Any
) -> Path:
    """Write a mission folder from the text of its files and the entries of its sensors."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, contents in files.items():
        data = contents if isinstance(contents, bytes) else contents.encode()
        (folder / name).write_bytes(data)
    described = {**description, "sensors": dict(sensors)}
    (folder / "mission.yaml").write_text(yaml.safe_dump(described, sort_keys=False))
    return folder


def one_sensor_folder(folder: Path, sensor_type: str, text: str | bytes, **entry: Any) -> Path:
    """A mission folder with one CSV file beside a depth sensor."""
    files: dict[str, str | bytes] = {"x.csv": text, "always.csv": DEPTH_CSV}
    sensors = {
        "x": {"type": sensor_type, "file": "x.csv", **entry},
        "always": {"type": "depth", "file": "always.csv"},
    }
    return make_folder(folder, files, sensors)
