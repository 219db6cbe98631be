"""Keypoints of other programs, where the libraries that own the formats are there."""

import sys

import numpy as np
import pytest
import tankrig as rig

CONFIG = """[camera]
fps = 50.0
[calibration]
metres_per_pixel = 0.001
origin_px = [100.0, 20.0]
[vision]
links = 2
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(CONFIG)
    return path


def marks() -> rig.Keypoints:
    position = np.array([[[100.0, 20.0], [110.0, 50.0], [120.0, 80.0]], [[100.0, 20.0], [np.nan, np.nan], [121.0, 79.5]]])
    confidence = np.array([[1.0, 0.9, 0.95], [1.0, 0.0, 0.3]])
    return rig.Keypoints(["base", "elbow", "tip"], position, confidence, np.array([4, 5]))


def test_marks_become_metres(config, tmp_path):
    trajectory = marks().to_trajectory(config, tmp_path / "t.csv", keypoints="base,elbow,tip")
    assert trajectory.keypoints == ["P0", "P1", "P2"]
    assert trajectory.time_s == pytest.approx([4 / 50.0, 5 / 50.0])
    assert trajectory.position_m[0, 1, [0, 2]] == pytest.approx([0.01, -0.03])
    # not marked, and less likely than wanted
    assert np.isnan(trajectory.position_m[1, 1:]).all()
    sure = marks().to_trajectory(config, tmp_path / "u.csv", keypoints="base,elbow,tip", least_likelihood=0.2, fps=10.0)
    assert sure.position_m[1, 2, [0, 2]] == pytest.approx([0.021, -0.0595]) and sure.time_s[1] == 0.5
    with pytest.raises(rig.InputError, match="elbo"):
        marks().to_trajectory(config, tmp_path / "v.csv", keypoints="base,elbo,tip")


def test_sleap_projects(config, tmp_path):
    sio = pytest.importorskip("sleap_io")
    skeleton = sio.Skeleton(["base", "elbow", "tip"])
    video = sio.Video(filename="film.mp4", open_backend=False)
    wanted = marks()
    track = sio.Track("arm")
    frames = [
        sio.LabeledFrame(
            video=video,
            frame_idx=int(number),
            instances=[
                sio.PredictedInstance.from_numpy(places, skeleton=skeleton, point_scores=sure, score=1.0, track=track)
            ],
        )
        for number, places, sure in zip(wanted.image, wanted.position_px, wanted.confidence)
    ]
    labels = sio.Labels(videos=[video], skeletons=[skeleton], tracks=[track], labeled_frames=frames)
    sio.save_slp(labels, str(tmp_path / "labels.slp"))
    for chosen in (None, "arm", 0):
        found = rig.from_sleap(tmp_path / "labels.slp", chosen)
        assert found.names == wanted.names and found.image.tolist() == [4, 5]
        assert np.allclose(found.position_px, wanted.position_px, equal_nan=True)
        assert found.confidence[0] == pytest.approx(wanted.confidence[0])
    with pytest.raises(rig.InputError, match="no track 'fin', but arm"):
        rig.from_sleap(tmp_path / "labels.slp", "fin")
    (tmp_path / "text.slp").write_text("no project")
    with pytest.raises(rig.InputError, match="text.slp"):
        rig.from_sleap(tmp_path / "text.slp")


def test_movement_there_and_back(tmp_path):
    pytest.importorskip("movement")
    position = np.full((3, 2, 3), np.nan)
    position[:, :, 0], position[:, :, 2] = [[0.0, 0.01], [0.0, 0.02], [0.0, np.nan]], [[0.0, -0.03], [0.0, -0.03], [0.0, np.nan]]
    trajectory = rig.Trajectory(np.array([0.0, 0.02, 0.04]), ["P0", "P1"], position)
    ds = rig.to_movement(trajectory)
    assert ds["position"].dims == ("time", "space", "keypoints", "individuals")
    assert ds["space"].values.tolist() == ["x", "z"] and ds["time"].values.tolist() == [0.0, 0.02, 0.04]
    assert float(ds["position"].sel(time=0.02, space="z", keypoints="P1").item()) == -0.03
    assert float(ds["confidence"].sel(time=0.04, keypoints="P1").item()) == 0.0
    assert ds.attrs["fps"] == pytest.approx(50.0) and ds.attrs["source_software"] == "rig"


def test_deeplabcut(config, tmp_path):
    load_poses = pytest.importorskip("movement.io.load_poses")
    save_poses = pytest.importorskip("movement.io.save_poses")
    wanted = marks()
    ds = load_poses.from_numpy(
        np.moveaxis(wanted.position_px, 2, 1)[..., np.newaxis],
        wanted.confidence[..., np.newaxis],
        individual_names=["one"],
        keypoint_names=wanted.names,
        fps=None,
    )
    found = rig.from_movement(ds)
    assert np.allclose(found.position_px, wanted.position_px, equal_nan=True) and found.image.tolist() == [0, 1]
    pytest.importorskip("tables")
    save_poses.to_dlc_file(ds, tmp_path / "tracked.h5", split_individuals=False)
    found = rig.from_deeplabcut(tmp_path / "tracked.h5")
    assert found.names == wanted.names and np.allclose(found.position_px, wanted.position_px, equal_nan=True)


def test_motion_capture(tmp_path):
    c3d = pytest.importorskip("c3d")
    writer = c3d.Writer(point_rate=200.0)
    rows = []
    for image in range(4):
        points = np.zeros((2, 5))
        points[0, :3], points[1, :3] = [10.0 * image, 20.0, 30.0], [1.0, 2.0, 3.0]
        if image == 2:
            points[0, 3] = -1.0
        rows.append((points, np.empty((0, 0))))
    writer.set_point_labels(["elbow", "tip"])
    writer.add_frames(rows)
    with (tmp_path / "walk.c3d").open("wb") as file:
        writer.write(file)
    found = rig.from_c3d(tmp_path / "walk.c3d", {"P2": "tip", "P1": "elbow"}, axes="x-zy")
    assert found.keypoints == ["P2", "P1"] and found.time_s == pytest.approx([0.0, 0.005, 0.01, 0.015])
    assert found.position_m[3, 1] == pytest.approx([0.03, -0.03, 0.02], abs=1e-6)
    assert np.isnan(found.position_m[2, 1]).all() and np.isfinite(found.position_m[2, 0]).all()
    with pytest.raises(rig.InputError, match="no marker 'fin', but elbow, tip"):
        rig.from_c3d(tmp_path / "walk.c3d", {"P1": "fin"})
    with pytest.raises(rig.InputError, match="axes"):
        rig.from_c3d(tmp_path / "walk.c3d", {"P1": "tip"}, axes="xzz")


TRC = """PathFileType\t4\t(X/Y/Z)\twalk.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
200.00\t200.00\t3\t2\tmm\t200.00\t1\t3
Frame#\tTime\telbow\t\t\ttip\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.500\t0.0\t20.0\t30.0\t1.0\t2.0\t3.0
2\t0.505\t10.0\t20.0\t30.0\t1.0\t2.0\t3.0
3\t0.510\t\t\t\t1.0\t2.0\t3.0
"""


def test_markers_as_opensim_takes_them(tmp_path):
    (tmp_path / "walk.trc").write_text(TRC)
    found = rig.from_trc(tmp_path / "walk.trc", {"P2": "tip", "P1": "elbow"}, axes="x-zy")
    assert found.keypoints == ["P2", "P1"] and found.time_s == pytest.approx([0.5, 0.505, 0.51])
    assert found.position_m[1, 1] == pytest.approx([0.01, -0.03, 0.02])
    assert np.isnan(found.position_m[2, 1]).all() and found.position_m[2, 0] == pytest.approx([0.001, -0.003, 0.002])
    assert rig.from_trc(tmp_path / "walk.trc", {"P1": "tip"}, start_s=0.0).time_s == pytest.approx([0.0, 0.005, 0.01])
    with pytest.raises(rig.InputError, match="no marker 'fin', but elbow, tip"):
        rig.from_trc(tmp_path / "walk.trc", {"P1": "fin"})
    (tmp_path / "walk.trc").write_text(TRC.replace("\tmm\t", "\tfeet\t"))
    with pytest.raises(rig.InputError, match="`feet`"):
        rig.from_trc(tmp_path / "walk.trc", {"P1": "tip"})
    (tmp_path / "walk.trc").write_text("time_s,P1_x_m\n0,1\n")
    with pytest.raises(rig.InputError, match="PathFileType"):
        rig.from_trc(tmp_path / "walk.trc", {"P1": "tip"})


def test_what_is_not_installed_is_said(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "sleap_io", None)
    with pytest.raises(rig.MissingPackage, match="pip install sleap-io"):
        rig.from_sleap(tmp_path / "labels.slp")
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        rig.Trajectory(np.zeros(1), ["P1"], np.zeros((1, 1, 3))).pandas()
