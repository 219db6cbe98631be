"""What tests share: models and MuJoCo's own runs of them, which lie with the simulation's tests."""

from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT / "sim" / "tests" / "data"


@pytest.fixture
def data() -> Path:
    return DATA


def golden(name: str) -> np.ndarray:
    """A run that MuJoCo made: a record array with ``time``, ``q1``, ``v1``, ``P1_x`` and so on."""
    return np.genfromtxt(DATA / f"{name}.csv", delimiter=",", names=True)


def columns(run: np.ndarray, prefix: str) -> np.ndarray:
    return np.stack([run[name] for name in run.dtype.names if name.startswith(prefix)], axis=1)


DROP = """model = "chain.xml"
[fit]
parameters = ["fluidcoef"]
max_evaluations = {evaluations}
method = "{method}"
[diagnose]
limit_s = 20.0
[[run]]
id = "drop"
kind = "drop"
trajectory = "drop.csv"
release_s = 0.5
"""


@pytest.fixture
def experiment(tmp_path: Path):
    """Makes the experiment of a drop that MuJoCo moved, the model's coefficients put back to what they are by default."""
    import tankrig as rig

    def make(method: str = "hybrid", evaluations: int = 3000) -> Path:
        text = (DATA / "chain_passive.xml").read_text()
        parts = text.split('fluidcoef="')
        wrong = [parts[0]] + ["0.5 0.25 1.5 1 1" + part[part.index('"'):] for part in parts[1:]]
        (tmp_path / "chain.xml").write_text('fluidcoef="'.join(wrong))
        run = golden("chain_passive_horizontal_euler")[::10]
        run = run[run["time"] <= 4.0]
        names = ["P1", "P2", "P3"]
        position = np.full((len(run), 3, 3), np.nan)
        for place, name in enumerate(names):
            position[:, place, 0], position[:, place, 2] = run[f"{name}_x"], run[f"{name}_z"]
        # half a second at rest, before; and what a camera adds
        still = np.repeat(position[:1], 50, axis=0)
        position = np.concatenate([still, position]) + np.random.default_rng(1).normal(0.0, 2e-4, (len(run) + 50, 3, 3))
        times = np.concatenate([np.arange(50) * 0.01, run["time"] + 0.5])
        rig.Trajectory(times, names, position).write(tmp_path / "drop.csv")
        path = tmp_path / "experiment.toml"
        path.write_text(DROP.format(method=method, evaluations=evaluations))
        return path

    return make
