"""Fits, diagnoses, run folders."""

import os
import signal
import threading
import time

import numpy as np
import pytest
import tankrig as rig


def test_a_fit_finds_what_mujoco_moved_by(experiment, data, tmp_path):
    told = []
    fit = rig.fit(experiment(), tmp_path / "out", progress=lambda *now: told.append(now))
    assert fit.loss_m2**0.5 < 1e-3 and fit.evaluations > 10
    true = rig.Model(data / "chain_passive.xml").parameters
    determined = [p for p in fit.parameters if p.determined]
    assert determined
    for p in determined:
        assert abs(p.value - true[p.name].value) < 5.0 * p.std, p
    assert told and all(isinstance(text, str) and done >= 0 for text, done, _ in told)
    assert fit.model.parameters[determined[0].name].value == pytest.approx(determined[0].value)
    # the same folder, read again; the report is what a notebook shows
    again = rig.Fit.read(tmp_path / "out")
    assert again.json == fit.json and again.parameters[0].name == fit.parameters[0].name
    assert "iframe" in fit._repr_html_() and determined[0].name in repr(fit)
    assert (tmp_path / "out" / "report.html").is_file()
    with pytest.raises(AttributeError, match="loss_m2"):
        fit.loss


def test_a_fit_leaves_nothing_behind(experiment):
    fit = rig.fit(experiment("least-squares"), progress=False)
    folder = fit.folder
    assert (folder / "fit.json").is_file()
    del fit
    assert not folder.exists()


def test_a_diagnosis_of_a_fit(experiment):
    fit = rig.fit(experiment("least-squares"), progress=False)
    told = []
    diagnosis = rig.diagnose(fit, progress=lambda *now: told.append(now))
    # MuJoCo moved the very model, so that nothing is wrong
    assert diagnosis.verdict == "nothing-detectable", diagnosis
    assert diagnosis.causes == [] and any("diagnosis" in text for text, *_ in told)


def test_ctrl_c_leaves_the_best_so_far(experiment, tmp_path):
    once = iter([lambda: threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT)).start()])

    def press(text, done, of):
        if done > 0:
            next(once, lambda: None)()

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt) as raised:
        rig.fit(experiment("cma-es", 100_000), tmp_path / "out", profile=True, progress=press)
    assert time.monotonic() - began < 30.0
    assert isinstance(raised.value, rig.Interrupted) and str(tmp_path / "out") in str(raised.value)
    assert raised.value.best.stop_reason == "interrupted" and raised.value.best.parameters


def test_what_a_progress_function_raises_ends_the_fit(experiment):
    def stop(*_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        rig.fit(experiment("cma-es", 100_000), progress=stop)


def test_experiments_that_are_none(tmp_path):
    with pytest.raises(rig.InputError, match="none.toml"):
        rig.fit(tmp_path / "none.toml")
    (tmp_path / "half.toml").write_text('model = "chain.xml"\n[fit]\nsed = 1\n')
    with pytest.raises(rig.InputError, match="sed"):
        rig.fit(tmp_path / "half.toml", tmp_path / "out")
    with pytest.raises(rig.DataError, match="fit.json"):
        rig.Fit.read(tmp_path)
    with pytest.raises(rig.InputError, match="no run folder"):
        rig.Run(tmp_path / "none")


def test_a_folder_of_results_as_a_run(tmp_path):
    (tmp_path / "trajectory.csv").write_text("time_s,P1_x_m,P1_z_m,P1_std_m,q1_rad\n0,0.1,-0.2,0.0004,0.5\n0.01,,,,0.6\n")
    (tmp_path / "servo.csv").write_text("time_s,servo_rad\n0,0\n1,0.5\n")
    run = rig.Run(tmp_path)
    assert run.trajectory.keypoints == ["P1", "q1_rad"]
    assert run.trajectory.position_m.shape == (2, 2, 3) and run.trajectory.std_m.shape == (2, 2)
    assert np.isnan(run.trajectory.position_m[1, 0]).all() and run.trajectory.position_m[0, 0, 2] == -0.2
    assert run.trajectory.columns()["q1_rad"] == pytest.approx([0.5, 0.6])
    assert run.servo.actuators == ["servo"] and run.servo.angle_rad.tolist() == [[0.0], [0.5]]
    with pytest.raises(rig.DataError, match="frames.csv"):
        run.images
    with pytest.raises(rig.DataError, match="diagnosis.json"):
        run.diagnosis
    assert "Run(" in run._repr_html_()
    pd = pytest.importorskip("pandas")
    assert run.servo.pandas().loc[1.0, "servo_rad"] == 0.5
    assert list(run.trajectory.pandas().columns) == ["P1_x_m", "P1_z_m", "q1_rad", "P1_std_m"]
    assert pd.isna(run.trajectory.pandas().loc[0.01, "P1_x_m"])


def test_a_broken_table_is_named_by_line(tmp_path):
    (tmp_path / "trajectory.csv").write_text("time_s,P1_x_m,P1_z_m\n0,0.1,-0.2\n0.01,a,0\n")
    with pytest.raises(rig.InputError, match="trajectory.csv"):
        rig.Run(tmp_path).trajectory


@pytest.mark.skipif("RIG_RUN" not in os.environ, reason="RIG_RUN names no run folder with pictures")
def test_a_run_with_pictures():
    run = rig.Run(os.environ["RIG_RUN"])
    assert len(run.images) == len(run.images.status) > 10
    picture = run.images[3]
    assert picture.dtype == np.uint8 and picture.ndim == 2 and picture.std() > 0
    several = run.images[3:6]
    assert len(several) == 3 and np.array_equal(several[0], picture)
    assert len(run.trajectory) <= len(run.images)
    assert run.fit.noise_m > 0 and run.start.id == run.id and run.stop.images >= len(run.images)
    assert "iframe" in run._repr_html_()
    motion = run.model.rollout(servo=run.servo, duration_s=0.1)
    assert motion.keypoints == run.model.keypoints
