"""Motion of models: MuJoCo's, many at once, derived."""

import numpy as np
import pytest
import tankrig as rig
from conftest import columns, golden


def stroke(time_s: np.ndarray, amplitude_rad: float) -> np.ndarray:
    """The 2:1 stroke of the reference runs."""
    p = np.mod(time_s + 0.5, 1.5)
    return np.where(p < 1.0, amplitude_rad * (2.0 * p - 1.0), amplitude_rad * (5.0 - 4.0 * p))


def corners(amplitude_rad: float) -> dict[str, np.ndarray]:
    time_s = np.arange(0.0, 11.0, 0.5)
    return {"time_s": time_s, "servo_rad": stroke(time_s, amplitude_rad)}


def test_a_drop_is_mujocos(data):
    run = golden("chain_passive_horizontal_euler")
    model = rig.Model(data / "chain_passive.xml")
    motion = model.rollout(columns(run, "q")[0], time_s=run["time"])
    assert np.abs(motion.qpos - columns(run, "q")).max() < 1e-9
    places = np.stack([columns(run, name) for name in ("P1", "P2", "P3")], axis=1)
    assert np.abs(motion.keypoint_m - places).max() < 1e-10


@pytest.mark.parametrize("integrator", ["euler", "implicitfast"])
def test_a_driven_chain_is_mujocos(data, integrator):
    run = golden(f"chain_active_{integrator}")
    motion = rig.Model(data / "chain_active.xml").rollout(
        servo=corners(0.6), time_s=run["time"], integrator=integrator, timestep_s=0.001
    )
    assert np.abs(motion.qpos - columns(run, "q")).max() < 1e-8


def test_candidates_move_as_each_alone(data):
    model = rig.Model(data / "chain_active.xml")
    rng = np.random.default_rng(2)
    params = {"g1/blunt": rng.uniform(0.1, 2.0, 37), "q2/damping": rng.uniform(0.0, 1e-5, 37), "g3/kutta": 0.4}
    qpos = rng.normal(0.0, 0.3, (37, 3))
    batch = model.rollout(qpos, servo=corners(0.4), params=params, duration_s=1.0)
    assert batch.qpos.shape == (37, 101, 3) and batch.keypoint_m.shape == (37, 101, 3, 3) and not batch.errors
    for k in (0, 15, 16, 36):
        one = model.with_parameters({"g1/blunt": params["g1/blunt"][k], "q2/damping": params["q2/damping"][k], "g3/kutta": 0.4})
        alone = one.rollout(qpos[k], servo=corners(0.4), duration_s=1.0)
        assert np.array_equal(alone.qpos, batch.qpos[k]) and np.array_equal(alone.qvel, batch.qvel[k])
        assert np.array_equal(alone.keypoint_m, batch.keypoint_m[k])
    assert np.array_equal(model.rollout(qpos, servo=corners(0.4), params=params, duration_s=1.0, threads=1).qpos, batch.qpos)


def test_a_candidate_that_cannot_be_disturbs_nobody(data):
    model = rig.Model(data / "chain_passive.xml")
    batch = model.rollout([1.0, 0.0, 0.0], params={"link2/mass": [0.004, -1.0, 0.005]}, duration_s=0.2)
    assert list(batch.errors) == [1] and isinstance(batch.errors[1], rig.InputError)
    assert "link2/mass" in str(batch.errors[1])
    assert np.isnan(batch.qpos[1]).all() and np.isfinite(batch.qpos[[0, 2]]).all()
    with pytest.raises(rig.InputError, match="link2/mass"):
        model.rollout([1.0, 0.0, 0.0], params={"link2/mass": -1.0}, duration_s=0.2)


def test_derivatives_are_those_of_differences(data):
    model = rig.Model(data / "chain_active.xml")
    at = {"g2/blunt": 0.7, "servo/gain": 0.05}
    motion = model.rollout([0.2, 0.1, 0.0], servo=corners(0.4), params=at, duration_s=1.0, every_s=0.1, jacobian=True)
    names = ["g2/blunt", "servo/gain", "qpos[0]", "qpos[1]", "qpos[2]", "qvel[0]", "qvel[1]", "qvel[2]"]
    assert motion.jacobian.names == names
    assert motion.jacobian.qpos.shape == (11, 3, 8) and motion.jacobian.keypoint_m.shape == (11, 3, 3, 8)
    plain = model.rollout([0.2, 0.1, 0.0], servo=corners(0.4), params=at, duration_s=1.0, every_s=0.1)
    assert np.allclose(plain.qpos, motion.qpos, rtol=0.0, atol=1e-12)

    def moved(name: str, by: float):
        params, state = dict(at), {"qpos": [0.2, 0.1, 0.0], "qvel": [0.0, 0.0, 0.0]}
        if "[" in name:
            state[name[:4]][int(name[5])] += by
        else:
            params[name] += by
        return model.rollout(state["qpos"], state["qvel"], servo=corners(0.4), params=params, duration_s=1.0, every_s=0.1)

    for place, name in enumerate(names):
        step = 1e-6 * at.get(name, 1.0)
        ahead, behind = moved(name, step), moved(name, -step)
        for exact, a, b in (
            (motion.jacobian.qpos, ahead.qpos, behind.qpos),
            (motion.jacobian.qvel, ahead.qvel, behind.qvel),
            (motion.jacobian.keypoint_m, ahead.keypoint_m, behind.keypoint_m),
        ):
            expected = (a - b) / (2.0 * step)
            assert np.abs(exact[..., place] - expected).max() < 1e-5 * (1e-3 + np.abs(expected).max()), name


def test_derivatives_of_a_batch_by_name(data):
    model = rig.Model(data / "chain_passive.xml")
    batch = model.rollout(np.array([[1.0, 0, 0], [0.5, 0, 0]]), jacobian=["g1/blunt"], duration_s=0.5)
    assert batch.jacobian.qpos.shape == (2, 51, 3, 1)
    alone = model.rollout([0.5, 0, 0], jacobian=["g1/blunt", "qpos[0]"], duration_s=0.5)
    assert np.array_equal(alone.jacobian.qpos[..., 0], batch.jacobian.qpos[1, ..., 0])


def test_steps_as_exact_as_asked_for(data):
    model = rig.Model(data / "chain_passive.xml")
    exact = model.rollout([1.5, 0, 0], integrator="rk4", timestep_s=1e-4, duration_s=3.0)
    ours = model.rollout([1.5, 0, 0], accuracy_m=1e-5, duration_s=3.0)
    assert np.abs(ours.keypoint_m - exact.keypoint_m).max() < 1e-5


def test_a_table_of_pandas_is_as_good_as_a_path(data, tmp_path):
    pd = pytest.importorskip("pandas")
    model = rig.Model(data / "chain_active.xml")
    table = pd.DataFrame(corners(0.3))
    table.to_csv(tmp_path / "servo.csv", index=False)
    runs = [model.rollout(servo=servo, duration_s=0.5).qpos for servo in (table, table.set_index("time_s"), tmp_path / "servo.csv", rig.Servo.read(tmp_path / "servo.csv"))]
    assert all(np.array_equal(runs[0], run) for run in runs[1:])
    params = pd.DataFrame({"g1/blunt": [0.5, 0.6]})
    batch = model.rollout(servo=table, params=params, duration_s=0.5)
    assert batch.qpos.shape == (2, 51, 3)
    assert list(batch.pandas(1).columns) == [f"{point}_{axis}_m" for point in ("P1", "P2", "P3") for axis in "xyz"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"qpos": [0.0, 1.0]}, "3 coordinates"),
        ({"qpos": [np.nan, 0.0, 0.0]}, "not finite"),
        ({"params": {"g9/blunt": 1.0}}, "has no parameter `g9/blunt`"),
        ({"params": {"g1/blunt": [1.0, 2.0]}, "qpos": np.zeros((3, 3))}, "differ in number"),
        ({"integrator": "leapfrog"}, "none of euler"),
        ({"servo": {"time_s": [0.0, 0.0], "servo_rad": [0.0, 1.0]}}, "time"),
        ({"servo": {"time_s": [0.0, 1.0], "motor_rad": [0.0, 1.0]}}, "motor"),
        ({"servo": {"servo_rad": [0.0]}}, "time_s"),
        ({"servo": "missing.csv"}, "missing.csv"),
        ({"jacobian": ["qpos[3]"]}, "qpos\\[3\\]"),
        ({"time_s": [1.0, 0.5]}, "must not fall"),
        ({"duration_s": -1.0}, "duration_s"),
        ({"timestep_s": 0.0}, "time step"),
    ],
)
def test_what_does_not_fit_is_said(data, arguments, said):
    with pytest.raises(rig.InputError, match=said):
        rig.Model(data / "chain_active.xml").rollout(**{"duration_s": 0.1, **arguments})


def test_models_that_are_none(tmp_path):
    with pytest.raises(rig.InputError, match="none.xml") as error:
        rig.Model(tmp_path / "none.xml")
    assert error.value.exit_code == 2 and isinstance(error.value, ValueError)
    with pytest.raises(rig.InputError):
        rig.Model.from_mjcf("<mujoco><worldbody><body><joint/></body>")


def test_parameters_and_mjcf_go_round(data):
    model = rig.Model(data / "chain_active.xml")
    assert model.joints == ["q1", "q2", "q3"] and model.actuators == ["servo"] and model.keypoints == ["P1", "P2", "P3"]
    damping = model.parameters["q2/damping"]
    assert (damping.value, damping.unit) == (2e-6, "N m s/rad")
    changed = model.with_parameters({"q2/damping": 5e-6})
    again = rig.Model.from_mjcf(changed.to_mjcf("by a test"))
    assert again.parameters["q2/damping"].value == 5e-6 and model.parameters["q2/damping"].value == 2e-6


def test_python_goes_on_meanwhile(data):
    import threading

    model = rig.Model(data / "arm8.xml")
    count, over = 0, threading.Event()
    thread = threading.Thread(target=lambda: (model.rollout(np.zeros((64, model.nq)), duration_s=5.0, threads=1), over.set()))
    thread.start()
    while not over.wait(0.001):
        count += 1
    thread.join()
    assert count > 10, count


def test_mujoco_itself_moves_it_so(data):
    mujoco = pytest.importorskip("mujoco")
    model = rig.Model(data / "chain_active.xml")
    theirs = mujoco.MjModel.from_xml_path(str(data / "chain_active.xml"))
    state = mujoco.MjData(theirs)
    rows = [state.qpos.copy()]
    for _ in range(1000):
        state.ctrl[0] = stroke(np.array(state.time), 0.5)
        mujoco.mj_step(theirs, state)
        rows.append(state.qpos.copy())
    ours = model.rollout(servo=corners(0.5), duration_s=1.0, every_s=0.001)
    assert np.abs(ours.qpos - np.array(rows)).max() < 1e-10
