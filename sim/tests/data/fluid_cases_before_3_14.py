"""Writes fluid_cases_before_3_14.csv: wrenches on single shapes by an engine whose Kutta lift was clamped.
Needs mujoco==3.13.0 and numpy.

python3 fluid_cases_before_3_14.py > fluid_cases_before_3_14.csv"""
import mujoco
import numpy as np

SIZES = {  # links of a few centimetres and of some decimetres: the clamp acts, acts in part, does not act
    "ellipsoid": [(0.015, 0.005, 0.0025), (0.15, 0.06, 0.03)],
    "box": [(0.015, 0.005, 0.0025), (0.12, 0.05, 0.02)],
    "capsule": [(0.004, 0.012), (0.03, 0.1)],
    "cylinder": [(0.004, 0.012), (0.04, 0.1)],
}
COEFFICIENTS = ("blunt", "slender", "angular", "kutta", "magnus")
XYZ = ("x", "y", "z")
assert mujoco.__version__.startswith("3.13."), mujoco.__version__

rng = np.random.default_rng(1)
head = ["kind", "s0", "s1", "s2", *COEFFICIENTS, "rho", "mu"]
print(",".join(head + [f"{q}{a}" for q in "wvtf" for a in XYZ]))
for kind, sizes in SIZES.items():
    for size in sizes:
        for speed in (0.002, 0.1, 1.0, 3.0):
            for _ in range(2):
                c = rng.uniform(0, 2, 5)
                model = mujoco.MjModel.from_xml_string(
                    f"""<mujoco><option gravity="0 0 0" density="1000" viscosity="0.0009"/><worldbody><body><freejoint/>
                    <geom type="{kind}" size="{' '.join(map(str, size))}" density="1000" fluidshape="ellipsoid"
                    fluidcoef="{' '.join(repr(float(x)) for x in c)}"/></body></worldbody></mujoco>"""
                )
                data = mujoco.MjData(model)
                v, w = rng.normal(0, speed, 3), rng.normal(0, 3, 3)
                data.qvel[:] = [*v, *w]
                mujoco.mj_forward(model, data)
                # the body's principal axes may be a permutation of the geom's; velocities are given in the body's
                assert np.allclose(model.geom_quat[0], [1, 0, 0, 0]) and np.allclose(model.geom_pos[0], 0)
                force, torque = data.qfrc_fluid[:3], data.qfrc_fluid[3:]
                row = [kind, *(list(size) + [0])[:3], *c, 1000.0, 0.0009, *w, *v, *torque, *force]
                print(",".join(x if isinstance(x, str) else repr(float(x)) for x in row))
