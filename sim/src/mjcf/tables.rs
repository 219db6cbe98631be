//! Which attributes are read, which are passed over, and which are fine as long as they say the default.

/// One element's attributes.
pub(super) struct Table {
    /// Names of the attributes that are read.
    pub(super) read: &'static [&'static str],
    /// Without effect on the motion of what is simulated here.
    pub(super) passed_over: &'static [&'static str],
    /// Only with one of these values, which change nothing.
    pub(super) only: &'static [(&'static str, &'static [&'static str])],
}

const COMPILER: Table = Table {
    read: &[
        "angle",
        "autolimits",
        "eulerseq",
        "inertiafromgeom",
        "inertiagrouprange",
        "boundmass",
        "boundinertia",
        "settotalmass",
    ],
    passed_over: &[
        "meshdir",
        "texturedir",
        "assetdir",
        "strippath",
        "usethread",
        "convexhull",
        "exactmeshinertia",
        "saveinertial",
        "conflict",
        "discardvisual",
    ],
    only: &[
        ("coordinate", &["local"]),
        ("balanceinertia", &["false"]),
        ("alignfree", &["false"]),
        ("fusestatic", &["false"]),
    ],
};

const OPTION: Table = Table {
    read: &["timestep", "integrator", "gravity", "density", "viscosity", "wind", "cone", "impratio"],
    passed_over: &[
        "solver",
        "iterations",
        "tolerance",
        "ls_iterations",
        "ls_tolerance",
        "jacobian",
        "ccd_iterations",
        "ccd_tolerance",
        "sdf_iterations",
        "sdf_initpoints",
        "o_margin",
        "o_solref",
        "o_solimp",
        "o_friction",
        "apirate",
        "magnetic",
        "noslip_tolerance",
        "sleep_tolerance",
    ],
    only: &[("noslip_iterations", &["0"])],
};

const ON: &[&str] = &["enable"];
const OFF: &[&str] = &["disable"];

const FLAG: Table = Table {
    read: &["contact", "constraint", "equality", "frictionloss", "limit", "gravity", "clampctrl"],
    passed_over: &[
        "warmstart",
        "midphase",
        "nativeccd",
        "sensor",
        "energy",
        "fwdinv",
        "multiccd",
        "island",
        "autoreset",
    ],
    only: &[
        ("passive", ON),
        ("spring", ON),
        ("damper", ON),
        ("filterparent", ON),
        ("actuation", ON),
        ("refsafe", ON),
        ("eulerdamp", ON),
        ("override", OFF),
        ("invdiscrete", OFF),
        ("sleep", OFF),
    ],
};

const BODY: Table = Table {
    read: &["name", "childclass", "pos", "quat", "axisangle", "xyaxes", "zaxis", "euler", "gravcomp"],
    passed_over: &["user", "sleep"],
    only: &[("mocap", &["false"])],
};

const FRAME: Table = Table {
    read: &["childclass", "pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"],
    passed_over: &["name"],
    only: &[],
};

const REPLICATE: Table = Table { read: &["count", "offset", "euler", "sep"], passed_over: &[], only: &[] };

const FIXED: Table = Table {
    read: &["name", "class", "range", "limited", "stiffness", "damping", "springlength"],
    passed_over: TENDON_DRAWS,
    only: &[("frictionloss", &["0"]), ("armature", &["0"])],
};

const SPATIAL: Table = Table {
    read: &["name", "class", "range", "limited"],
    passed_over: TENDON_DRAWS,
    only: &[("stiffness", &["0"]), ("damping", &["0"]), ("frictionloss", &["0"]), ("armature", &["0"])],
};

/// Of tendons without end stops and friction.
const TENDON_DRAWS: &[&str] = &[
    "group",
    "width",
    "material",
    "rgba",
    "springlength",
    "user",
    "margin",
    "solreflimit",
    "solimplimit",
    "solreffriction",
    "solimpfriction",
];

/// A joint of a fixed tendon.
const TERM: Table = Table { read: &["joint", "coef"], passed_over: &[], only: &[] };

const INERTIAL: Table = Table {
    read: &["pos", "quat", "axisangle", "xyaxes", "zaxis", "euler", "mass", "diaginertia", "fullinertia"],
    passed_over: &[],
    only: &[],
};

const JOINT: Table = Table {
    read: &[
        "name",
        "class",
        "type",
        "pos",
        "axis",
        "range",
        "limited",
        "stiffness",
        "damping",
        "springref",
        "ref",
        "armature",
        "frictionloss",
        "margin",
        "solreflimit",
        "solimplimit",
        "solreffriction",
        "solimpfriction",
    ],
    passed_over: &["group", "user"],
    only: &[
        ("springdamper", &["0 0"]),
        ("actuatorfrcrange", &["0 0"]),
        ("actuatorfrclimited", &["false", "auto"]),
        ("actuatorgravcomp", &["false"]),
    ],
};

const FREEJOINT: Table =
    Table { read: &["name"], passed_over: &["group"], only: &[("align", &["false", "auto"])] };

const GEOM: Table = Table {
    read: &[
        "name",
        "class",
        "type",
        "size",
        "pos",
        "quat",
        "axisangle",
        "xyaxes",
        "zaxis",
        "euler",
        "fromto",
        "mass",
        "density",
        "fluidshape",
        "fluidcoef",
        "contype",
        "conaffinity",
        "margin",
        "gap",
        "condim",
        "friction",
        "solmix",
        "solref",
        "solimp",
        "priority",
        "group",
        "mesh",
        "hfield",
    ],
    passed_over: &["material", "rgba", "user", "fitscale"],
    only: &[("shellinertia", &["false"])],
};

const SITE: Table = Table {
    read: &["name", "class", "pos", "fromto"],
    passed_over: &[
        "type",
        "size",
        "group",
        "material",
        "rgba",
        "quat",
        "axisangle",
        "xyaxes",
        "zaxis",
        "euler",
        "user",
    ],
    only: &[],
};

/// An actuator's table: what says by which law it pushes is read beside what all have.
macro_rules! actuator {
    ($($law:literal),*) => {
        Table {
            read: &[
                "name", "class", "joint", "jointinparent", "tendon", "gear", "ctrlrange", "ctrllimited", "forcerange",
                "forcelimited", $($law),*
            ],
            passed_over: &[
                "group", "user", "lengthrange", "dynprm", "site", "refsite", "body", "cranksite", "slidersite",
                "cranklength", "actdim", "actlimited", "actrange", "actearly", "input",
            ],
            only: &[("delay", &["0"]), ("nsample", &["0"]), ("armature", &["0"]), ("damping", &["0"])],
        }
    };
}

const GENERAL: Table = actuator!("gainprm", "biasprm", "gaintype", "biastype", "dyntype");
const POSITION: Table = actuator!("kp", "kv", "dampratio", "timeconst", "inheritrange");
const VELOCITY: Table = actuator!("kv");
const MOTOR: Table = actuator!();

/// Only what it has defaults for; see [`super::coupling`].
const EQUALITY: Table = Table { read: &["active"], passed_over: &[], only: &[] };

const EXCLUDE: Table = Table { read: &["name", "body1", "body2"], passed_over: &[], only: &[] };

/// The table of the element `tag`, where it has one.
pub(super) fn table(tag: &str) -> Option<&'static Table> {
    Some(match tag {
        "compiler" => &COMPILER,
        "option" => &OPTION,
        "flag" => &FLAG,
        "body" => &BODY,
        "frame" => &FRAME,
        "replicate" => &REPLICATE,
        "fixed" | "tendon" => &FIXED,
        "spatial" => &SPATIAL,
        "term" => &TERM,
        "equality" => &EQUALITY,
        "inertial" => &INERTIAL,
        "joint" => &JOINT,
        "freejoint" => &FREEJOINT,
        "geom" => &GEOM,
        "site" => &SITE,
        "general" => &GENERAL,
        "position" => &POSITION,
        "velocity" => &VELOCITY,
        "motor" => &MOTOR,
        "exclude" => &EXCLUDE,
        _ => return None,
    })
}
