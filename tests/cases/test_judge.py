"""What counts as right, part, ambiguous, unexplained, missed and wrong. `python3 -m unittest` in this folder runs it."""

import unittest

from judge import Judge


def truth(*faults, description=None, outside=None, tracker=None):
    return {"faults": list(faults), "description": description, "outside": outside, "tracker": tracker}


def fault(cause, element=None, by_run=False, **parameters):
    return {"cause": cause, "elements": [element], "by_run": by_run, "parameters": {k.replace("__", "/"): v for k, v in parameters.items()}}


def cause(name, element=None, **more):
    return {"name": name, "element": element, "parameters": [], **more}


def answer(verdict, causes=(), **more):
    return {"verdict": verdict, "causes": list(causes), **more}


BUBBLE, LAG = fault("buoyancy", "link2"), fault("servo_lag")
KNOCKED = {"kind": "camera_knocked", "runs": ["drop-2"]}
LATE = {"kind": "release", "runs": ["drop-1", "drop-2"]}


class Outcomes(unittest.TestCase):
    def says(self, outcome, hidden, diagnosis, refusal=""):
        self.assertEqual(Judge(hidden, diagnosis, refusal).outcome()[0], outcome)

    def test_one_fault(self):
        self.says("right", truth(BUBBLE), answer("cause", [cause("buoyancy", "link2")]))
        # no video tells the two apart
        self.says("right", truth(BUBBLE), answer("cause", [cause("link_mass", "link2")]))
        self.says("right", truth(fault("servo_delay")), answer("cause", [cause("camera_delay", aliases=["servo_delay"])]))
        self.says("part", truth(BUBBLE), answer("cause", [cause("buoyancy")]))
        self.says("part", truth(LAG), answer("cause", [cause("servo_lag", by_run=True)]))
        self.says("part", truth(LAG), answer("unexplained", established=[cause("servo_lag")]))
        self.says("wrong", truth(BUBBLE), answer("cause", [cause("buoyancy", "link3")]))
        self.says("wrong", truth(BUBBLE), answer("causes", [cause("buoyancy", "link2"), cause("current")]))
        self.says("missed", truth(BUBBLE), answer("nothing-detectable"))
        self.says("unexplained", truth(BUBBLE), answer("unexplained"))
        self.says("no answer", truth(BUBBLE), None)

    def test_any_word_of_certainty_counts(self):
        self.says("wrong", truth(LAG), answer("unexplained", established=[cause("tether")]))
        self.says("wrong", truth(LAG), answer("suspected", [cause("tether")]))
        self.says("wrong", truth(LAG), answer("cause", [cause("servo_lag")], suspects=["run drop-1 does not belong"]))
        # the best description of what is unexplained is no cause
        self.says("unexplained", truth(LAG), answer("unexplained", partial=[cause("tether")]))

    def test_several(self):
        both = truth(BUBBLE, LAG)
        self.says("right", both, answer("causes", [cause("servo_lag"), cause("buoyancy", "link2")]))
        self.says("part", both, answer("cause", [cause("servo_lag")]))
        self.says("ambiguous", both, answer("ambiguous", [cause("tether")], alternatives=[{"names": ["servo_lag", "buoyancy/link2"]}]))
        self.says("wrong", both, answer("ambiguous", [cause("tether")], alternatives=[{"names": ["current"]}]))

    def test_nothing(self):
        self.says("right", truth(), answer("nothing-detectable"))
        self.says("unexplained", truth(), answer("unexplained"))
        self.says("wrong", truth(), answer("cause", [cause("current")]))

    def test_what_no_cause_covers(self):
        vortex, slack = {"kind": "vortex", "near": []}, {"kind": "slack", "near": ["tether"]}
        self.says("right", truth(outside=vortex), answer("unexplained"))
        self.says("missed", truth(outside=vortex), answer("nothing-detectable"))
        self.says("wrong", truth(outside=vortex), answer("unexplained", established=[cause("current")]))
        self.says("part", truth(outside=slack), answer("cause", [cause("tether")]))
        self.says("right", truth(LAG, outside=vortex), answer("unexplained", established=[cause("servo_lag")]))
        self.says("unexplained", truth(LAG, outside=vortex), answer("unexplained"))

    def test_wrong_descriptions(self):
        knocked, late = truth(description=KNOCKED), truth(description=LATE)
        self.says("right", knocked, answer("unexplained", suspects=["drop-2 does not belong: look at it first"]))
        self.says("wrong", knocked, answer("unexplained", suspects=["drop-1 does not belong: look at it first"]))
        self.says("wrong", knocked, answer("cause", [cause("camera_offset", by_run=True)]))
        self.says("part", knocked, answer("cause", [cause("camera_offset", form="one run: drop-2")]))
        self.says("unexplained", knocked, answer("unexplained"))
        self.says("missed", knocked, answer("nothing-detectable"))
        self.says("right", late, answer("cause", [cause("release_offset")]))
        self.says("right", late, answer("cause", [cause("camera_delay", form="drops only")]))
        self.says("wrong", late, answer("cause", [cause("camera_delay")]))
        units = truth(description={"kind": "millimetres", "runs": ["drop-1"]})
        self.says("right", units, None, "rig: drop-1.csv: keypoints 1000 times as far apart as the links are long: millimetres?")
        self.says("unexplained", units, None, "rig: no candidate could be simulated")
        reversed_ = truth(description={"kind": "servo_reversed", "runs": ["driven-1"]})
        gain = lambda value: cause("servo_gain") | {"parameters": [{"name": "servo_gain/scale", "value": value, "ci95": [value, value]}]}
        self.says("right", reversed_, answer("cause", [gain(-2.01)]))
        self.says("wrong", reversed_, answer("cause", [gain(-0.4)]))

    def test_by_run(self):
        bubbles = truth(fault("buoyancy", by_run=True))
        self.says("right", bubbles, answer("cause", [cause("buoyancy", by_run=True)]))
        self.says("part", bubbles, answer("cause", [cause("buoyancy")]))
        self.says("right", bubbles, answer("unexplained", suspects=["something differs from run to run and resembles buoyancy"]))

    def test_intervals(self):
        hidden = truth(fault("current", current__x=0.01))
        number = {"name": "current/x", "value": 0.012, "ci95": [0.009, 0.015]}
        own = {"name": "current/x@drop-1", "value": 0.02, "ci95": [0.019, 0.021]}
        other = {"name": "current/z", "value": 0.0, "ci95": [0.0, 0.0]}
        judge = Judge(hidden, answer("cause", [cause("current") | {"parameters": [number, own, other]}]))
        self.assertEqual([held for _, held, _ in judge.intervals("causes")], [True, False])


if __name__ == "__main__":
    unittest.main()
