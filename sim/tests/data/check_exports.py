"""Whether models move the same way in MuJoCo before and after they went through ours. Needs mujoco and numpy.

cargo build -p sim --example export && python3 check_exports.py ../../../target/debug/examples/export"""
import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np

HERE = Path(__file__).resolve().parent
NUMBERS = 1e-9  # one second of rounding, over how much MuJoCo itself blows up a rounding error


def moved(xml, case, steps):
    m = mujoco.MjModel.from_xml_string(xml)
    m.opt.tolerance, m.opt.iterations, m.opt.ls_tolerance = 0, 200, 1e-12
    d = mujoco.MjData(m)
    for field in ("qpos", "qvel", "ctrl"):
        if field in case:
            getattr(d, field)[:] = case[field]
    for _ in range(steps):
        mujoco.mj_step(m, d)
    return np.concatenate([d.qpos, d.qvel])


def main():
    cases = json.loads((HERE / "random_models.json").read_text())
    cases += [{"xml": (HERE / f"{name}.xml").read_text(), "growth": 1} for name in ("chain_passive", "chain_friction", "chain_active", "arm8")]
    cases.append({"xml": (HERE / "octopus8.xml").read_text(), "growth": 1, "steps": 100})
    worst = 0
    for index, case in enumerate(cases):
        exported = subprocess.run(sys.argv[1], input=case["xml"], capture_output=True, text=True, check=True).stdout
        steps = case.get("steps", 1000)
        before, after = moved(case["xml"], case, steps), moved(exported, case, steps)
        apart = np.abs(after - before).max() / max(np.abs(before).max(), 1e-300) / max(case["growth"], 1)
        worst = max(worst, apart)
        if apart > NUMBERS:
            print(f"case {index}: {apart:.1e}")
    print(f"{len(cases)} models, worst relative difference after a second {worst:.1e}, MuJoCo {mujoco.__version__}")
    sys.exit(worst > NUMBERS)


if __name__ == "__main__":
    main()
