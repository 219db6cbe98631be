"""How near a diagnosis came to what is hidden. Knows the shape of diagnosis.json and nothing of who wrote it."""

import json
import re

OUTCOMES = ["right", "part", "ambiguous", "unexplained", "missed", "wrong", "no answer"]
# No video tells these two apart; others that a program itself declares stand in its `aliases`
ONE_NAME = {"buoyancy": {"link_mass"}, "link_mass": {"buoyancy"}}
# A wrong description is named by a statement (an entry under `suspects`, the sentence, a refusal's text) that has these words ...
A_RUN = r"belong|unlike|not like|other mechanism|spoil|look at it first"
LABELS = r"label|swap|exchang|change[ds]? over|\border\b"
STATEMENTS = {
    "release": r"release|let go", "release_one": r"release|let go", "release_each": r"release|let go",
    "labels_run": rf"{A_RUN}|{LABELS}", "labels_images": rf"{A_RUN}|{LABELS}",
    "clock_rate": r"clock.?rate|clock runs|images? (a|per) second|frame rate|fps",
    "axes": r"axes|x and z|exchang", "y_not_z": r"axes|\by\b.*\bz\b|y_m", "z_down": r"z .*down|\bsigns?\b|upside|mirror|picture rows",
    "mirrored": r"mirror|\bsigns?\b|revers|other way", "servo_reversed": r"mirror|\bsigns?\b|revers|other way",
    "millimetres": r"millimet|\bmm\b|\bunits?\b", "pixels": r"pixel|\bpx\b|\bunits?\b", "degrees": r"degree|\bdeg\b|\bunits?\b",
    "frame_numbers": r"frame number|image number|numbers? of images", "milliseconds": r"millisecond|\bms\b",
    "zeros_lost": r"\(0, ?0\)|fixed point|same point|lost|misread|set aside", "order_reversed": rf"{LABELS}|revers",
    "other_mechanism": A_RUN, "camera_knocked": rf"{A_RUN}|knock|camera.*mov|shift", "images_lost": rf"{A_RUN}|lost|missing|gap|dropped",
}
# ... or by a cause that is the same thing in the project's words
AS_CAUSE = {
    "release": ["release_offset"], "release_one": ["release_offset"], "release_each": ["release_offset"],
    "labels_run": ["swapped_labels"], "labels_images": ["swapped_labels"], "order_reversed": ["swapped_labels"],
    "clock_rate": ["clock_rate"], "mirrored": ["servo_gain"], "servo_reversed": ["servo_gain"],
}
REVERSED = (-2.3, -1.7)  # what a reversed servo's gain is within
# Names that are not wrong where they are said of the spoilt run alone, or of drops alone where the release is off: the second is right.
# "Differently in each run" is wrong where one run differs.
NEARLY = {
    "release": ["camera_delay"], "release_one": ["camera_delay"], "release_each": ["camera_delay"],
    "camera_knocked": ["camera_offset", "camera_rotation"], "images_lost": ["camera_delay"],
}
# A bias over the pose is a slip at each pose
NEAR_TRACKER = {"pose_bias": ["keypoint_slip"]}
ONE_RUN = {"labels_run", "labels_images", "other_mechanism", "camera_knocked", "images_lost", "release_one"}
# Where the remarks are the place to say it
IN_REMARKS = {"zeros_lost"}
WIDTH_SD = 3.92  # of a 95 % interval
UNLIKELY = 0.5  # a suspect less probable than this is no statement


def text(entry):
    return entry if isinstance(entry, str) else json.dumps(entry)


def is_by_run(cause):
    """Whether a named cause has numbers of each run's own, or of some runs only."""
    return bool(cause.get("by_run")) or cause.get("form", "all") not in ("all", "common", None)


class Judge:
    """One case's truth against one program's answer."""

    def __init__(self, hidden, diagnosis, refusal=""):
        self.hidden, self.diagnosis, self.refusal = hidden, diagnosis, refusal
        self.kind = (hidden["description"] or {}).get("kind")
        self.spoilt = (hidden["description"] or {}).get("runs", [])
        self.other = (hidden["tracker"] or {}).get("kind")
        self.false, self.whole, self.partly, self.near, self.described = [], set(), set(), False, False

    def place(self, name, element, aliases=()):
        """The hidden fault that this name and element mean, and whether wholly; (None, False): none."""
        names = {name, *aliases} | ONE_NAME.get(name, set())
        best = (None, False)
        for k, fault in enumerate(self.hidden["faults"]):
            if fault["cause"] in names:
                if element in fault["elements"]:
                    return k, True
                if element is None:
                    best = k, False
        return best

    def take(self, cause):
        """Counts a named cause."""
        name, element = cause["name"], cause.get("element")
        if "/" in name:
            name, element = name.split("/", 1)
        k, whole = self.place(name, element, cause.get("aliases") or ())
        # a sloshing water's phase is each run's own whatever the form
        slosh = name == "slosh"
        if k is not None:
            same_form = slosh or is_by_run(cause) == self.hidden["faults"][k]["by_run"]
            (self.whole if whole and same_form else self.partly).add(k)
        elif name in AS_CAUSE.get(self.kind, []) and (name != "servo_gain" or self.is_reversed(cause)):
            self.described = True
        elif name in NEARLY.get(self.kind, []) and self.is_of_spoilt(cause):
            self.near = True
            self.described |= self.kind.startswith("release")
        elif name in NEAR_TRACKER.get(self.other, []) or name in (self.hidden["outside"] or {}).get("near", []):
            self.near = True
        else:
            self.false.append(name if element is None else f"{name}/{element}")

    def is_reversed(self, cause):
        return any(REVERSED[0] <= p["value"] <= REVERSED[1] for p in cause.get("parameters", []))

    def is_of_spoilt(self, cause):
        """Whether a named cause's form says: in the spoilt run alone, or in drops alone."""
        form = str(cause.get("form", ""))
        return "drop" in form if self.kind in ("release", "release_each") else self.spoilt[0] in form

    def is_statement(self, said):
        """Whether a text says what is wrong with the description."""
        if self.kind is None or not re.search(STATEMENTS[self.kind], said, re.I):
            return False
        return self.kind not in ONE_RUN or self.spoilt[0] in said

    def listen(self):
        """Counts what is said of the description."""
        d = self.diagnosis
        for entry in d.get("suspects") or []:
            said = text(entry)
            if isinstance(entry, dict) and entry.get("probability", 1.0) < UNLIKELY:
                continue
            about_tracker = self.other is not None and re.search(r"tracker|misread|outlier|gap|pose|quanti|round", said, re.I)
            by_run = [f for f in self.hidden["faults"] if f["by_run"] and f["cause"] in said]
            if self.is_statement(said):
                self.described = True
            elif by_run:
                self.whole.add(self.hidden["faults"].index(by_run[0]))
            elif not about_tracker:
                self.false.append(f"suspects: {said[:60]}")
        heard = [d.get("sentence") or "", self.refusal]
        if self.kind in IN_REMARKS:
            heard += [text(remark) for remark in d.get("remarks") or []]
        # what names a cause is no statement about the files
        if self.kind is not None and not self.described and not d.get("causes"):
            self.described = any(self.is_statement(said) for said in heard)
        # "buoyancy differs from run to run" names no force and is the truth
        differs = " ".join(text(x) for x in [d.get("sentence") or "", *(d.get("remarks") or [])])
        for k, fault in enumerate(self.hidden["faults"]):
            if fault["by_run"] and fault["cause"] in differs and re.search(r"differ\w* from run to run|in each run", differs):
                self.whole.add(k)

    def sets(self):
        """Sets of an ambiguous verdict: of (name, element)."""
        split = lambda name: tuple(name.split("/", 1)) if "/" in name else (name, None)
        leader = [(c["name"], c.get("element"), tuple(c.get("aliases") or ())) for c in self.diagnosis.get("causes", [])]
        others = [[(*split(name), ()) for name in other["names"]] for other in self.diagnosis.get("alternatives", [])]
        return [leader, *others]

    def outcome(self):
        """One of `OUTCOMES`, and the false names."""
        d, wanted = self.diagnosis, len(self.hidden["faults"]) + (self.kind is not None)
        if d is None:
            if self.is_statement(self.refusal):
                return ("right" if wanted == 1 else "part"), []
            return ("unexplained" if self.refusal and self.kind else "no answer"), []
        verdict = d["verdict"]
        ambiguous = verdict == "ambiguous"
        for cause in (d.get("established") or []) + (d.get("suspected") or []) + ([] if ambiguous else d.get("causes") or []):
            self.take(cause)
        self.listen()
        if self.false:
            return "wrong", self.false
        if ambiguous:
            true = [s for s in self.sets() if s and all(self.place(*member)[0] is not None for member in s)]
            return ("ambiguous" if true else "wrong"), ([] if true else [f"{n}/{e}" if e else n for n, e, _ in self.sets()[0]])
        silent = verdict == "nothing-detectable"
        strange = self.hidden["outside"] is not None or self.other == "pose_bias"
        if wanted == 0:
            if self.near:
                return "part", []
            if strange:
                return ("missed" if silent else "right"), []
            return ("right" if silent else "unexplained"), []
        if self.kind == "zeros_lost" and silent and self.described:
            return "right", []
        found = len(self.whole) + self.described
        if found == wanted and (verdict != "unexplained" or strange or self.kind or self.whole_by_run()):
            return "right", []
        if found or self.partly or self.near:
            return "part", []
        return ("missed" if silent else "unexplained"), []

    def whole_by_run(self):
        return any(fault["by_run"] for fault in self.hidden["faults"])

    def intervals(self, key):
        """Of the true causes under `key`: parameter, whether its interval holds the truth, how far off it is in standard deviations."""
        truth = {name: value for fault in self.hidden["faults"] for name, value in fault["parameters"].items()}
        found = []
        for cause in (self.diagnosis or {}).get(key) or []:
            for p in cause.get("parameters", []):
                # a run's own number of what is the same in all runs should be that size
                true = truth.get(p["name"], truth.get(p["name"].split("@")[0]))
                if true is not None and p.get("ci95"):
                    low, high = p["ci95"]
                    deviation = max((high - low) / WIDTH_SD, 1e-300)
                    found.append((p["name"], low <= true <= high, abs(p["value"] - true) / deviation))
        return found
