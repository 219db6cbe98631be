"""The EMPS benchmark (nonlinearbenchmark.org) as an experiment: fitted to the estimation record, held out is the validation record.

    python3 emps.py DATA OUT
    rig fit OUT/emps.toml --out OUT/fit
"""

import csv

from tables import folders, run, write_table

MODEL = """<mujoco model="emps">
  <option gravity="0 0 0" timestep="0.001"/>
  <worldbody>
    <body name="car">
      <joint name="axis" type="slide" axis="1 0 0" damping="200"/>
      <inertial pos="0 0 0" mass="95" diaginertia="1 1 1"/>
      <site name="P1" pos="0 0 0"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="axis"/></actuator>
  <custom>
    <numeric name="coulomb_friction/torque" data="20"/>
    <numeric name="coulomb_friction/rate" data="0.001"/>
    <numeric name="coulomb_friction/breakaway" data="0.1"/>
    <numeric name="coulomb_friction/stribeck_rate" data="0.01"/>
    <numeric name="gear_friction/driving" data="0.05"/>
    <numeric name="gear_friction/driven" data="0.05"/>
    <numeric name="gear_friction/rate" data="0.001"/>
  </custom>
</mujoco>
"""

FIT = """model = "emps.xml"
noise_m = 0.001
[fit]
method = "least-squares"
parameters = ["car/mass", "axis/damping", "coulomb_friction/torque", "coulomb_friction/breakaway", "coulomb_friction/stribeck_rate", "gear_friction/driving", "gear_friction/driven", "drive_offset/motor"]
[fit.bounds]
"axis/damping" = [1.0, 1000.0]
"coulomb_friction/stribeck_rate" = [0.002, 0.1]
"coulomb_friction/torque" = [0.0, 100.0]
"""

# 1000 samples a second are more than a smooth motion takes: every fourth is an image, all of them are forces
EVERY = 4


def main():
    data, out = folders(__doc__)
    text = FIT
    for name, use in (("estimation", "fit"), ("validation", "holdout")):
        with open(data / f"{name}.csv") as file:
            rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        # motor_N is all that pushes: with pulse_N added to it the validation record is missed by 15 cm
        forces = ([row["time_s"], row["motor_N"]] for row in rows)
        write_table(out / f"{name}-servo.csv", ["time_s", "motor_N"], forces)
        write_table(out / f"{name}.csv", ["time_s", "P1_x_m"], ([row["time_s"], row["q_m"]] for row in rows[::EVERY]))
        text += run(name, kind="free", init_s=0.02, trajectory=f"{name}.csv", servo=f"{name}-servo.csv", use=use)
    (out / "emps.xml").write_text(MODEL)
    (out / "emps.toml").write_text(text)


main()
