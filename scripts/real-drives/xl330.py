"""Recordings of a Dynamixel XL330 turning a pendulum (Rhoban/bam, bam/data.bak/raw) as experiments: one for each gain, held out while the others are fitted.

    python3 xl330.py DATA OUT          then, for KP of 100, 200, 400:
    rig fit OUT/without-KP.toml --out OUT/fit-KP
    python3 xl330_scores.py OUT
"""

import json

from tables import folders, run, write_table

# 0.49 kg at 0.1 m, as recorded; the bar between is not stated: 50 g to begin with, evenly along it
MODEL = """<mujoco model="xl330">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.001"/>
  <worldbody>
    <body name="bar">
      <joint name="horn" axis="0 -1 0" damping="0.015" armature="0.002"/>
      <inertial pos="0 0 -0.05" mass="0.05" diaginertia="4.2e-5 4.2e-5 1e-6"/>
      <site name="P0" pos="0 0 0"/>
      <body name="weight" pos="0 0 -0.1">
        <inertial pos="0 0 0" mass="0.49" diaginertia="1e-4 1e-4 1e-4"/>
        <site name="P1" pos="0 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="horn" kp="0.18"/></actuator>
  <custom>
    <numeric name="back_emf/braking" data="0.015"/>
    <numeric name="coulomb_friction/torque" data="0.01"/>
    <numeric name="coulomb_friction/rate" data="0.01"/>
    <numeric name="gear_friction/driving" data="0.1"/>
    <numeric name="gear_friction/driven" data="1"/>
    <numeric name="gear_friction/rate" data="0.01"/>
    <numeric name="servo_delay/delay" data="0.005"/>
  </custom>
</mujoco>
"""

# what is fitted, and how large it may be; the gain is that of the P register at 100. The delay stays: a goal that jumps has no derivative by it
FIT = """model = "xl330.xml"
noise_m = 0.001
[fit]
method = "least-squares"
parameters = ["horn/armature", "horn/damping", "servo/gain", "bar/mass", "back_emf/braking", "coulomb_friction/torque", "gear_friction/driving", "gear_friction/driven", "joint_zero/horn"]
[fit.bounds]
"back_emf/braking" = [0.0, 0.3]
"bar/mass" = [0.001, 0.3]
"coulomb_friction/torque" = [0.0, 0.2]
"horn/armature" = [0.0, 0.02]
"horn/damping" = [0.0, 0.3]
"servo/gain" = [0.03, 3.0]
"""


def table(record):
    """The servo table of one record: commands as they were sent, what the servo told."""
    for entry in record["entries"]:
        names = ("timestamp", "goal_position", "torque_enable", "position", "load", "input_volts", "temp")
        yield [entry[name] for name in names]


def main():
    data, out = folders(__doc__)
    titles = ["time_s", "servo_rad", "servo_on", "servo_measured_rad", "servo_load", "servo_V", "servo_C"]
    records = {}
    for path in sorted(data.glob("kp*.json")):
        record = json.loads(path.read_text())
        write_table(out / f"{path.stem}.csv", titles, table(record), head="# hold = steps\n")
        records[path.stem] = record["kp"]
    (out / "xl330.xml").write_text(MODEL)
    gains = sorted(set(records.values()))
    for held_out in gains:
        text = FIT
        for name, gain in records.items():
            keys = {"use": "holdout"} if gain == held_out else {}
            times = f'{{ "servo/gain" = {gain / 100} }}'
            text += run(name, kind="driven", servo=f"{name}.csv", times=times, **keys)
        (out / f"without-{held_out}.toml").write_text(text)


main()
