"""Which models of somebody's folder are read here, and whether they move as in MuJoCo. Needs mujoco and numpy.

cargo build -p sim --example moved && python3 check_models.py ../../../target/debug/examples/moved [--saved] MODEL.xml...

--saved: what MuJoCo itself saves of each. Each model begins aside its reference, moving and driven, and is stepped for half a second as it stands in its file but for the solver, which is
told to converge. `theirs`: by how much MuJoCo itself comes out differently when it starts 1e-13 aside."""
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np

SECONDS, NUDGE = 0.5, 1e-13


def moved(m, start, steps):
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:], d.ctrl[:] = start
    for _ in range(steps):
        mujoco.mj_step(m, d)
    return np.concatenate([d.qpos, d.qvel])


def main():
    tool, *models = [argument for argument in sys.argv[1:] if argument != "--saved"]
    folder = tempfile.TemporaryDirectory()
    read = 0
    for path in models:
        label = "/".join(Path(path).parts[-2:])
        try:
            m = mujoco.MjModel.from_xml_path(path)
        except ValueError as error:
            print(f"{label} | not a model for MuJoCo | {str(error).splitlines()[0]}")
            continue
        if "--saved" in sys.argv:
            path = str(Path(folder.name) / Path(path).name)
            mujoco.mj_saveLastXML(path, m)
            m = mujoco.MjModel.from_xml_path(path)
        m.opt.tolerance, m.opt.iterations, m.opt.ls_tolerance, m.opt.ls_iterations = 0, 300, 1e-14, 200
        m.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        if m.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT:  # read, but not taken
            m.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        rng = np.random.default_rng(47)
        d = mujoco.MjData(m)
        mujoco.mj_integratePos(m, d.qpos, rng.normal(0, 0.05, m.nv), 1.0)
        start = d.qpos.copy(), rng.normal(0, 0.2, m.nv), rng.normal(0, 0.2, m.nu)
        steps = max(1, round(SECONDS / m.opt.timestep))
        case = {"qpos": start[0].tolist(), "qvel": start[1].tolist(), "ctrl": start[2].tolist(), "steps": steps}
        ours = subprocess.run([tool, path], input=json.dumps(case), capture_output=True, text=True)
        if ours.returncode != 0:
            lines = ours.stderr.strip()
            print(f"{label} | refused | {lines}")
            continue
        read += 1
        ours = json.loads(ours.stdout)
        theirs = moved(m, start, steps)
        aside = moved(m, (start[0], start[1] * (1 + NUDGE), start[2]), steps)
        size = np.abs(theirs).max(initial=1e-300)
        names = [mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_JOINT, i) or f"#{i}" for i in range(m.njnt)]
        if [a for a, b in zip(names, ours["joints"]) if "#" not in a and a != b] or len(names) != len(ours["joints"]):
            print(f"{label} | other joints | {names} and {ours['joints']}")
        ours = np.concatenate([ours["qpos"], ours["qvel"]])
        print(f"{label} | read | {np.abs(ours - theirs).max(initial=0) / size:.1e}, theirs {np.abs(aside - theirs).max(initial=0) / size:.1e}")
    print(f"{read} of {len(models)} read, MuJoCo {mujoco.__version__}")


if __name__ == "__main__":
    main()
