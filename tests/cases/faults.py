"""What may be hidden in a tank: causes by the project's names, at natural sizes, and effects that it has no cause for."""

import numpy as np

from mechanism import WATER_KG_M3, GRAVITY_M_S2

# Causes of the first family, each about twice in forty cases
ORDINARY = (
    "buoyancy link_mass coulomb_friction stiffness joint_damping link_length joint_zero current added_mass servo_lag servo_delay "
    "servo_gain servo_sag servo_rate_limit backlash camera_delay camera_scale camera_rotation camera_offset camera_tilt keypoint_slip "
    "rolling_shutter tether cob_offset linear_drag slosh lens"
).split()
# Of what hides several at once, at most so many of each group
GROUPS = {
    "weight": (1, ["buoyancy", "link_mass"]),
    "hinge": (2, ["coulomb_friction", "stiffness"]),
    "water": (1, ["current", "added_mass"]),
    "drive": (2, ["servo_lag", "servo_gain", "joint_zero"]),
    "camera": (2, ["camera_delay", "camera_offset", "camera_rotation", "camera_scale", "keypoint_slip", "link_length"]),
}
OUTSIDE = ["vortex", "wake", "detent", "drift", "slack", "damper"]
# Names that are not wrong where the effect is at work although it is no instance of the cause
NEAR = {"slack": ["tether"]}
# Parameters that say where or how often, not how strong
SHAPES = ("tether/x", "tether/z", "slosh/frequency", "coulomb_friction/soft", "outside/seed", "outside/wake_s", "outside/notches",
          "outside/slack_x", "outside/slack_z", "outside/slack_length")


class Fault:
    """A cause at work, or an outside effect; `runs` holds values by run where they differ."""

    def __init__(self, cause, element, values, runs=None):
        self.cause, self.element, self.values, self.runs = cause, element, values, runs

    def at(self, run):
        """Parameters at work in a run."""
        return {**self.values, **(self.runs or {}).get(run, {})}

    def scaled(self, factor):
        """The same, so much stronger. A greatest rate is the other way round."""
        def scale(values):
            times = lambda name: 1.0 if name in SHAPES else 1.0 / factor if name == "servo_rate_limit/rate" else factor
            return {name: value * times(name) for name, value in values.items()}
        return Fault(self.cause, self.element, scale(self.values), self.runs and {run: scale(v) for run, v in self.runs.items()})

    def said(self, mechanism):
        """As it should be found."""
        names = {name: value for name, value in self.values.items() if name != "coulomb_friction/soft"}
        for run, values in (self.runs or {}).items():
            names.update({f"{name}@{run}": value for name, value in values.items()})
        # with two links only one hinge lies between links: all together are that one
        alike = [None, "q2"] if mechanism.links == 2 and self.cause == "stiffness" else [self.element]
        return {"cause": self.cause, "elements": alike, "by_run": bool(self.runs), "parameters": names}


def draw(cause, mechanism, strokes, random):
    """A fault of this cause at a natural size."""
    m, torque, sign = mechanism, mechanism.torque_n_m(), float(random.choice([-1.0, 1.0]))
    even = random.uniform
    heavier = abs(m.density_kg_m3 - WATER_KG_M3) / WATER_KG_M3
    link = int(random.integers(1, m.links + 1))
    hinge = int(random.integers(2, m.links + 1))
    # the bar with two tails turns about its middle, and its weight shows nowhere
    heavy = hinge if m.kind == "tails" and link == 1 else link
    one = lambda values, element=None: Fault(cause, element, values)
    if cause == "buoyancy":
        return one({f"buoyancy/link{heavy}": sign * even(0.1, 0.3) * heavier}, f"link{heavy}")
    if cause == "link_mass":
        return one({f"link_mass/link{heavy}": sign * even(0.1, 0.25) * heavier}, f"link{heavy}")
    if cause == "coulomb_friction":
        all_, soft = random.random() < 0.4, {"coulomb_friction/soft": 1.0} if random.random() < 0.5 else {}
        size = even(0.03, 0.1) * torque
        return one({"coulomb_friction/torque" if all_ else f"coulomb_friction/q{hinge}": size, **soft}, None if all_ else f"q{hinge}")
    if cause == "stiffness":
        return one({f"stiffness/q{hinge}": even(0.3, 0.9) * torque}, f"q{hinge}")
    if cause == "joint_damping":
        return one({f"joint_damping/q{hinge}": even(1.5, 4.0) * m.damping}, f"q{hinge}")
    if cause == "link_length":
        link = int(random.choice(m.long_links()))
        return one({f"link_length/link{link}": sign * even(0.02, 0.04) * m.length_m}, f"link{link}")
    if cause == "joint_zero":
        return one({"joint_zero/q1": sign * even(0.015, 0.05)}, "q1")
    if cause == "current":
        return one({"current/x": sign * even(0.004, 0.010), "current/z": even(-0.004, 0.004)})
    if cause == "added_mass":
        return one({"added_mass/scale": even(0.3, 1.0)})
    if cause == "servo_rate_limit":
        times = np.linspace(0.0, 2.0, 2001)
        quickest = max(np.abs(np.gradient(s.command(times), times[1])).max() for s in strokes)
        return one({"servo_rate_limit/rate": even(0.5, 0.75) * quickest})
    if cause == "keypoint_slip":
        return one({f"keypoint_slip/P{link}": sign * even(0.02, 0.04) * m.length_m}, f"P{link}")
    if cause == "camera_offset":
        size, turn = even(3e-4, 8e-4), even(0.0, 2 * np.pi)
        return one({"camera_offset/x": size * np.cos(turn), "camera_offset/z": size * np.sin(turn)})
    if cause == "tether":
        place = {"tether/x": sign * even(0.5, 1.2) * m.reach_m(), "tether/z": even(-0.8, 0.8) * m.reach_m()}
        return one({"tether/stiffness": even(0.3, 0.8) * torque * m.links / m.reach_m() ** 2, **place})
    if cause == "cob_offset":
        lifted = WATER_KG_M3 * m.width_m * m.depth_m * m.length_m * GRAVITY_M_S2
        along, across = sign * even(0.05, 0.15) * torque / lifted, even(-0.15, 0.15) * torque / lifted
        return one({"cob_offset/along": along, "cob_offset/across": across})
    if cause == "slosh":
        size = even(0.006, 0.012)
        turns = even(0.0, 2 * np.pi, len(RUNS))
        runs = {run: {"slosh/sin": size * np.cos(a), "slosh/cos": size * np.sin(a)} for (run, *_), a in zip(RUNS, turns)}
        return Fault(cause, None, {"slosh/frequency": even(0.7, 1.6)}, runs)
    low, high, signed, parameter = {
        "servo_lag": (0.01, 0.035, False, "time"),
        "servo_delay": (0.01, 0.03, False, "delay"),
        "servo_gain": (0.03, 0.07, True, "scale"),
        "servo_sag": (0.03, 0.08, False, "rate"),
        "backlash": (0.01, 0.03, False, "half_width"),
        "camera_delay": (0.006, 0.02, True, "delay"),
        "camera_scale": (0.01, 0.025, True, "scale"),
        "camera_rotation": (0.01, 0.025, True, "angle"),
        "camera_tilt": (0.2, 0.5, True, "x"),
        "rolling_shutter": (0.1, 0.3, True, "slowness"),
        "lens": (2.0, 5.0, True, "radial"),
        "linear_drag": (1e-3, 3e-3, False, "drag"),
    }[cause]
    return one({f"{cause}/{parameter}": (sign if signed else 1.0) * even(low, high)})


# Runs of a case: two drops and two driven runs, one of each held out
RUNS = [("drop-1", "drop", "fit"), ("drop-2", "drop", "holdout"), ("driven-1", "driven", "fit"), ("driven-2", "driven", "holdout")]


def draw_several(mechanism, strokes, random):
    """Three to five small faults that do not exclude each other."""
    wanted, left = int(random.integers(3, 6)), {group: most for group, (most, _) in GROUPS.items()}
    pool = [(group, cause) for group, (_, causes) in GROUPS.items() for cause in causes]
    chosen = []
    for k in random.permutation(len(pool)):
        group, cause = pool[k]
        if left[group] and len(chosen) < wanted and not (cause == "link_length" and not mechanism.long_links()):
            left[group] -= 1
            chosen.append(draw(cause, mechanism, strokes, random))
    return chosen


def draw_by_run(kind, mechanism, random):
    """A cause with another size in each run."""
    heavier = abs(mechanism.density_kg_m3 - WATER_KG_M3) / WATER_KG_M3
    sizes = {"buoyancy": [("scale", 0.12 * heavier)], "camera_delay": [("delay", 0.009)],
             "camera_offset": [("x", 7e-4), ("z", 7e-4)]}[kind]
    runs = {run: {f"{kind}/{p}": size * random.standard_normal() for p, size in sizes} for run, *_ in RUNS}
    return Fault(kind, None, {}, runs)


def draw_outside(kind, mechanism, random):
    """An effect that no cause covers."""
    m, torque, even = mechanism, mechanism.torque_n_m(), random.uniform
    reach = m.reach_m()
    values = {
        "vortex": lambda: {"outside/vortex": even(0.6, 1.2)},
        "wake": lambda: {"outside/wake": even(0.3, 0.5), "outside/wake_s": even(0.3, 0.8)},
        "detent": lambda: {"outside/detent": even(0.08, 0.2) * torque, "outside/notches": 8.0},
        "drift": lambda: {"outside/drift": even(0.1, 0.25) * torque},
        "slack": lambda: {"outside/slack": even(0.5, 1.5) * torque * m.links / reach**2 * 3.0,
                          "outside/slack_x": float(random.choice([-1.0, 1.0])) * 0.7 * reach, "outside/slack_z": -0.2 * m.away * reach,
                          "outside/slack_length": even(1.0, 1.2) * reach},
        "damper": lambda: {"outside/damper": even(0.3, 0.8) * m.damping},
    }[kind]()
    return Fault(f"outside/{kind}", None, {**values, "outside/seed": float(random.integers(1 << 31))})
