"""`Model.rollout` beside MuJoCo's own `mujoco.rollout`, one thread each, in one run: python rollout.py [chain_passive | chain_active]

Needs tankrig (a release build: pip install ./rig/python) and mujoco. Prints a JSON line for each way of stepping: processor time of a candidate's
run of 10 s, the ratio of the two, how far the motions are apart; then the same of gradients by the fifteen fluid coefficients, which
MuJoCo has by central differences. Both move candidates of different coefficients and give coordinates and velocities of every sample."""

import json
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
import tankrig as rig
from mujoco import rollout

DATA = Path(__file__).resolve().parents[3] / "sim" / "tests" / "data"
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
DURATION_S, TIMESTEP_S, EVERY_S = 10.0, 0.001, 0.01
# Candidates of one call: ours fills its lanes and plans its steps once a call, MuJoCo has one after the other. The best of so many calls is
# the figure: the others shared the machine.
OURS, THEIRS, REPEATS = 512, 4, 5
COEFFICIENTS = ["blunt", "slender", "angular", "kutta", "magnus"]


def stroke(time_s, amplitude_rad=0.6):
    p = np.mod(time_s + 0.5, 1.5)
    return np.where(p < 1.0, amplitude_rad * (2.0 * p - 1.0), amplitude_rad * (5.0 - 4.0 * p))


class Theirs:
    """MuJoCo's own."""

    def __init__(self, name, coefficients, qpos, timestep_s=TIMESTEP_S):
        self.models = []
        for values in coefficients:
            model = mujoco.MjModel.from_xml_path(str(DATA / f"{name}.xml"))
            model.opt.timestep = timestep_s
            model.geom_fluid[:, 1:6] = values.reshape(model.ngeom, 5)
            self.models.append(model)
        self.steps, model = round(DURATION_S / timestep_s), self.models[0]
        self.data = mujoco.MjData(model)
        self.data.qpos[:] = qpos
        start = np.empty(mujoco.mj_stateSize(model, FULL))
        mujoco.mj_getState(model, self.data, start, FULL)
        self.start = np.tile(start, (len(self.models), 1))
        self.control = stroke(np.arange(self.steps) * timestep_s)[:, None] if model.nu else None
        self.every, self.nq = round(EVERY_S / timestep_s), model.nq

    def __call__(self):
        """Coordinates at each sample after the first, shape (B, N - 1, nq)."""
        state, _ = rollout.rollout(self.models, self.data, self.start, self.control, nstep=self.steps)
        return state[:, self.every - 1 :: self.every, 1 : 1 + self.nq]


def timed(work):
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def best(*works):
    """Shortest processor times [s] of works that take turns, and what they gave."""
    rounds = [[timed(work) for work in works] for _ in range(REPEATS)]
    return [min(times[place][0] for times in rounds) for place in range(len(works))], [result for _, result in rounds[0]]


def main():
    name = sys.argv[1] if len(sys.argv) > 1 else "chain_passive"
    model = rig.Model(DATA / f"{name}.xml")
    names = [f"g{link}/{of}" for link in (1, 2, 3) for of in COEFFICIENTS]
    nominal = np.array([model.parameters[one].value for one in names])
    candidates = nominal * np.random.default_rng(1).uniform(0.8, 1.25, (OURS, len(names)))
    drives = name == "chain_active"
    qpos = [0.0, 0.0, 0.0] if drives else [np.pi / 2, 0.0, 0.0]
    corners = np.arange(0.0, DURATION_S + 0.5, 0.5)
    servo = {"time_s": corners, "servo_rad": stroke(corners)} if drives else None
    params = dict(zip(names, candidates.T))
    theirs = Theirs(name, candidates[:THEIRS], qpos)
    exact = Theirs(name, candidates[:1], qpos, TIMESTEP_S / 50)()[0]

    def moved(**how):
        return model.rollout(qpos, servo=servo, params=params, duration_s=DURATION_S, every_s=EVERY_S, threads=1, **how)

    def sites(qpos_of_one):
        """Where P1 to P3 are, x and z [m]: all links hang from the one before."""
        turned, lengths = np.cumsum(qpos_of_one, axis=-1), np.array([0.025, 0.025, 0.0275])
        return np.stack([np.cumsum(lengths * np.sin(turned), axis=-1), np.cumsum(-lengths * np.cos(turned), axis=-1)], axis=-1)

    def apart(a, b):
        return float(np.linalg.norm(sites(a) - sites(b), axis=-1).max())

    allowed_m = apart(theirs()[0], exact)
    ways = {"the same steps, Euler 1 ms": {"integrator": "euler", "timestep_s": TIMESTEP_S}, "as exact as MuJoCo's steps": {"accuracy_m": 0.8 * allowed_m}}
    for way, how in ways.items():
        (theirs_s, ours_s), (their_qpos, motion) = best(theirs, lambda: moved(**how))
        theirs_s, ours_s = theirs_s / THEIRS, ours_s / OURS
        line = {
            "model": name,
            "steps": way,
            "mujoco_s": theirs_s,
            "tankrig_s": ours_s,
            "ratio": theirs_s / ours_s,
            "apart_m": max(apart(motion.qpos[k, 1:], their_qpos[k]) for k in range(THEIRS)),
            "error_m": apart(motion.qpos[0, 1:], exact),
            "mujoco_error_m": allowed_m,
        }
        print(json.dumps(line), flush=True)

    # gradients of the nominal candidate
    step = 1e-4
    around = np.concatenate([nominal + sign * step * np.eye(len(names)) for sign in (1.0, -1.0)])
    differences = Theirs(name, around, qpos)
    how = ways["as exact as MuJoCo's steps"]

    def derived():
        return model.rollout(qpos, servo=servo, params=dict(zip(names, nominal)), duration_s=DURATION_S, every_s=EVERY_S, threads=1, jacobian=names, **how)

    (theirs_s, ours_s), (runs, motion) = best(differences, derived)
    slopes = (runs[: len(names)] - runs[len(names) :]) / (2.0 * step)
    exact_slopes = np.moveaxis(motion.jacobian.qpos[1:], 2, 0)
    line = {
        "model": name,
        "gradients": f"{len(names)} coefficients",
        "mujoco_s": theirs_s,
        "tankrig_s": ours_s,
        "ratio": theirs_s / ours_s,
        "apart": float(np.abs(slopes - exact_slopes).max() / np.abs(exact_slopes).max()),
    }
    print(json.dumps(line))


if __name__ == "__main__":
    main()
