"""Mechanisms as their owners describe them: chains of two to five links, a bar with two tails, chains lighter than water.

SI units. World axes as in the project: x to the right, z up in the picture, hinges turn about -y (counter-clockwise is positive).
"""

import numpy as np

WATER_KG_M3, GRAVITY_M_S2, VISCOSITY_PA_S = 998.0, 9.81, 0.00095  # fresh water of 22 degrees C
# MuJoCo's defaults for the ellipsoid's blunt, slender, angular, Kutta and Magnus coefficients: what somebody begins with
NOMINAL = np.array([0.5, 0.25, 1.5, 1.0, 1.0])
# Spread of the true coefficients and dampings about the nominal ones (of their logarithms): a guess from the paper's fits
COEFFICIENT_SPREAD, DAMPING_SPREAD = 0.3, 0.35
DAMPING_N_M_S = 2e-6  # of a hinge between links of 25 mm, as in the shipped models
# A position servo's stiffness over mass times length squared [1/s^2] and its damping over its stiffness [s]: near the shipped models
SERVO_STIFFNESS_1_S2, SERVO_DAMPING_S = 500.0, 0.01
LEAST_SERVO_STIFFNESS_N_M = 0.05
SHAPES = {"chain": [2, 3, 3, 4, 5], "tails": [5], "floating": [2, 3, 4]}


class Mechanism:
    """What is drawn of a mechanism; `kind` is a key of `SHAPES`."""

    def __init__(self, kind, random):
        self.kind = kind
        self.links = int(random.choice(SHAPES[kind]))
        self.length_m = random.uniform(0.022, 0.038)
        self.width_m = self.length_m * random.uniform(0.25, 0.4)
        self.depth_m = self.length_m * random.uniform(0.12, 0.22)
        self.geom = str(random.choice(["box", "box", "capsule", "ellipsoid", "cylinder"]))
        self.density_kg_m3 = random.uniform(780, 900) if kind == "floating" else random.uniform(1120, 1500)
        self.taper = float(random.choice([1.0, 1.0, 0.92]))
        # +1: the chain stands up from its motor at the bottom
        self.away = 1.0 if kind == "floating" else -1.0
        self.damping = DAMPING_N_M_S * (self.length_m / 0.025) ** 3
        # a drop frees the driven hinge where the servo is described by its angle; else the servo holds it
        self.led = bool(self.links < 3 or kind == "tails" or random.random() < 0.7)
        self.coefficients = NOMINAL * np.exp(COEFFICIENT_SPREAD * random.standard_normal((self.links, 5)))
        self.damping_factors = np.exp(DAMPING_SPREAD * random.standard_normal(self.links))

    def parent(self, link):
        """Number of the link that `link` hangs on; 0: the tank. Links are counted from 1."""
        return {2: 1, 3: 2, 4: 1, 5: 4}.get(link, 0) if self.kind == "tails" else link - 1

    def child(self, link):
        """Whether another link hangs on this one's end."""
        return any(self.parent(other) == link for other in range(1, self.links + 1))

    def long_links(self):
        """Links whose length a child's place shows: all that carry one, but for the bar with two."""
        return [k for k in range(1, self.links + 1) if self.child(k) and not (self.kind == "tails" and k == 1)]

    def torque_n_m(self):
        """Moment of one link's weight in water about its hinge."""
        volume = self.width_m * self.depth_m * self.length_m
        return abs(self.density_kg_m3 - WATER_KG_M3) * volume * GRAVITY_M_S2 * self.length_m / 2

    def reach_m(self):
        """Greatest distance of a keypoint from the origin."""
        return self.length_m * (2.5 if self.kind == "tails" else sum(self.taper**k for k in range(self.links)))

    def _body(self, link, at, own, longer, lines, margin):
        """Lines of a link and of what hangs on it; `own` are its coefficients and damping factor."""
        bar = self.kind == "tails" and link == 1
        scale = self.taper ** (link - 1) if self.kind != "tails" else 1.0
        half, wide, deep = (x * scale / 2 for x in (self.length_m, self.width_m, self.depth_m))
        round_ = self.geom in ("capsule", "cylinder")
        size = f"{deep:.6g} {half:.6g}" if round_ else f"{wide:.6g} {deep:.6g} {half:.6g}"
        extra = longer.get(link, 0.0)
        end = (0.0, self.away * (2 * half + extra))
        lines += [
            f'{margin}<body name="link{link}" pos="{at[0]:.9g} 0 {at[1]:.9g}" gravcomp="{WATER_KG_M3 / self.density_kg_m3:.8g}">',
            f'{margin}  <joint name="q{link}" damping="{self.damping * own[1]:.8g}"/>',
            f'{margin}  <geom name="g{link}" type="{self.geom}" size="{size}"'
            + (' euler="0 1.5707963267948966 0"' if bar else f' pos="0 0 {self.away * half:.9g}"')
            + f' density="{self.density_kg_m3:.6g}" fluidcoef="{" ".join(f"{x:.8g}" for x in own[0])}"/>',
        ]
        if bar:
            lines.append(f'{margin}  <site name="P1" pos="{half:.9g} 0 0"/>')
            ends = {2: (-half, 0.0), 4: (half, 0.0)}
        else:
            lines.append(f'{margin}  <site name="P{link}" pos="0 0 {end[1]:.9g}"/>')
            ends = {k: end for k in range(1, self.links + 1) if self.parent(k) == link}
        return ends

    def mjcf(self, true=False, longer=None):
        """The model: as its owner has it, or as it is, with links `longer` by so much."""
        longer = longer or {}
        lines = [
            '<mujoco model="mechanism">',
            '  <compiler angle="radian" autolimits="true"/>',
            f'  <option timestep="0.001" gravity="0 0 {-GRAVITY_M_S2}" density="{WATER_KG_M3}" viscosity="{VISCOSITY_PA_S}"/>',
            '  <default><geom contype="0" conaffinity="0" fluidshape="ellipsoid"/><joint type="hinge" axis="0 -1 0"/></default>',
            "  <worldbody>",
        ]

        def add(link, at, margin):
            own = (self.coefficients[link - 1], self.damping_factors[link - 1]) if true else (NOMINAL, 1.0)
            ends = self._body(link, at, own, longer, lines, margin)
            for child, place in ends.items():
                add(child, place, margin + "  ")
            lines.append(f"{margin}</body>")

        add(1, (0.0, 0.0), "    ")
        mass = self.density_kg_m3 * self.width_m * self.depth_m * self.length_m * self.links
        stiffness = max(LEAST_SERVO_STIFFNESS_N_M, SERVO_STIFFNESS_1_S2 * mass * self.reach_m() ** 2)
        lines += [
            "  </worldbody>",
            f'  <actuator><position name="servo" joint="q1" kp="{stiffness:.6g}" kv="{stiffness * SERVO_DAMPING_S:.6g}"/></actuator>',
            "</mujoco>",
        ]
        return "\n".join(lines) + "\n"

    def held(self, random):
        """Joint angles in which somebody holds the mechanism before a drop."""
        angles = 0.5 * random.standard_normal(self.links)
        if self.kind == "tails":
            angles = np.array([0.5, 0.9, 0.3, 0.9, 0.3]) * random.uniform(0.6, 1.3, 5) * random.choice([-1.0, 1.0], 5)
        angles[0] = random.uniform(0.7, 1.5) * random.choice([-1.0, 1.0])
        if not self.led:
            angles[1:] *= 1.6
            angles[1] = random.uniform(0.7, 1.4) * random.choice([-1.0, 1.0])
            angles[0] = 0.0
        return angles
