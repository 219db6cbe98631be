"""From a run folder to coefficients, what they are worth, and how the mechanism would move with others: python coefficients.py RUN

RUN is what `rig run` leaves. Needs tankrig alone."""

import sys

import numpy as np
import tankrig as rig

run = rig.Run(sys.argv[1])
print(run.trajectory, run.servo, run.images)

# Fitted again, by default settings of its config; the folder is gone with the fit.
fit = rig.fit(run.path)
print(fit)

# How far simulated and measured keypoints are apart.
start = fit.runs[0]
print("rms, as the fit has it:", {k.name: round(k.rms_error_m * 1e3, 3) for k in start.keypoints}, "mm")

# How sure is the motion, given how sure the coefficients are? A thousand candidates drawn from them, moved at once.
free = [p for p in fit.parameters if p.determined and p.std]
if not free:
    raise SystemExit("this run determines none of them: make a longer one")
rng = np.random.default_rng(1)
draws = {p.name: np.clip(rng.normal(p.value, p.std, 1000), p.lower, p.upper) for p in free}
motion = fit.model.rollout(servo=run.servo, params=draws, time_s=run.trajectory.time_s, accuracy_m=1e-4)
spread_mm = np.nanstd(motion.keypoint_m, axis=0).max(axis=0) * 1e3
for name, (x, _, z) in zip(motion.keypoints, spread_mm):
    print(f"{name}: the coefficients leave {x:.3f} mm in x, {z:.3f} mm in z")

# Which coefficient moves the tip most? Exact derivatives, times how unsure each is.
names = [p.name for p in free]
derived = fit.model.rollout(servo=run.servo, time_s=run.trajectory.time_s, accuracy_m=1e-4, jacobian=names)
reach_mm = np.abs(derived.jacobian.keypoint_m[:, -1]).max(axis=(0, 1)) * [p.std for p in free] * 1e3
for name, mm in sorted(zip(names, reach_mm), key=lambda pair: -pair[1]):
    print(f"{name}: one sigma is {mm:.3f} mm at {derived.keypoints[-1]}")
