"""Writes moving_base.csv: the passive chain hanging from a carriage a million times heavier than itself, which constant forces drive along a parabola
while it turns ever faster. Needs mujoco and numpy."""

from pathlib import Path

import mujoco
import numpy as np

HERE = Path(__file__).parent
VELOCITY = [0.15, -0.1, 1.5]  # m/s, m/s, rad/s at 0 s
ACCELERATION = [-0.3, 0.4, -2.0]  # m/s2, m/s2, rad/s2

chain = (HERE / "chain_passive.xml").read_text()
option, rest = chain.split("<worldbody>")
links, end = rest.split("</worldbody>")
carriage = """<body name="carriage" gravcomp="1">
  <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/><joint name="turn" axis="0 -1 0"/>
  <inertial pos="0 0 0" mass="1e6" diaginertia="1e6 1e6 1e6"/>
  <geom type="sphere" size="0.001" fluidcoef="0 0 0 0 0"/>"""
drives = "".join(f'<motor joint="{joint}"/>' for joint in ("x", "z", "turn"))
links = links.replace('pos="0 0 0"', 'pos="0.03 0 0.01"', 1)
model = mujoco.MjModel.from_xml_string(
    f"{option}<worldbody>{carriage}{links}</body></worldbody><actuator>{drives}</actuator>{end}"
)
model.opt.timestep = 0.0005
model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
data = mujoco.MjData(model)
data.qvel[:3] = VELOCITY
data.qpos[3:] = [0.8, -0.4, 0.2]
data.ctrl[:] = [1e6 * ACCELERATION[0], 1e6 * ACCELERATION[1], 1e6 * ACCELERATION[2]]
sites = [f"P{k}" for k in (1, 2, 3)]
lines = ["time,q0,q1,q2," + ",".join(f"{site}_{axis}" for site in sites for axis in "xyz")]
for step in range(2001):
    mujoco.mj_forward(model, data)
    if step % 100 == 0:
        wanted = np.array(VELOCITY) * data.time + 0.5 * np.array(ACCELERATION) * data.time**2
        assert np.abs(data.qpos[:3] - wanted).max() < 1e-8, data.qpos[:3] - wanted
        row = [data.time, *data.qpos[3:], *np.concatenate([data.site(site).xpos for site in sites])]
        lines.append(",".join(f"{x:.12g}" for x in row))
    mujoco.mj_step(model, data)
(HERE / "moving_base.csv").write_text("\n".join(lines) + "\n")
