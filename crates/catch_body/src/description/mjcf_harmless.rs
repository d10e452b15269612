//! Elements and attributes of MuJoCo's model files that change neither an arm nor the shape and the mass of an object.

use crate::document::Harmless;

/// They draw, sense, simulate, or say how contacts and controllers behave. Geoms of the world itself stand around the arm.
pub(super) const HARMLESS: Harmless = &[
    (
        "mujoco",
        &["option", "size", "visual", "statistic", "custom", "sensor", "keyframe", "contact", "tendon"],
    ),
    ("compiler", &["@texturedir", "@usethread", "@convexhull", "@exactmeshinertia", "@alignfree", "@saveinertial"]),
    ("asset", &["texture", "material", "skin", "model", "hfield"]),
    ("mesh", &["@smoothnormal", "@maxhullvert", "@inertia", "@content_type"]),
    ("worldbody", &["geom", "site", "camera", "light"]),
    ("frame", &["@name", "camera", "light"]),
    ("body", &["@mocap", "@gravcomp", "@user", "@sleep", "camera", "light"]),
    ("inertial", &["@name"]),
    ("freejoint", &["@group", "@align"]),
    (
        "joint",
        &[
            "@group", "@solreflimit", "@solimplimit", "@solreffriction", "@solimpfriction", "@solref", "@solimp", "@stiffness", "@springref",
            "@springdamper", "@frictionloss", "@margin", "@user", "@actuatorgravcomp", "@joint1", "@joint2", "@polycoef", "@active",
        ],
    ),
    ("connect", &["*"]),
    ("equality", &["tendon", "flex"]),
    (
        "geom",
        &[
            "@name", "@rgba", "@material", "@group", "@priority", "@condim", "@solmix", "@solref", "@solimp", "@margin", "@gap", "@user",
            "@fluidshape", "@fluidcoef",
        ],
    ),
    ("site", &["@type", "@size", "@rgba", "@material", "@group", "@user"]),
    (
        "default",
        &["site", "camera", "light", "pair", "equality", "tendon", "material"],
    ),
    (
        "actuator",
        &["@*"],
    ),
    ("motor", ACTUATOR),
    ("general", ACTUATOR),
    ("position", ACTUATOR),
    ("velocity", ACTUATOR),
    ("intvelocity", ACTUATOR),
    ("damper", ACTUATOR),
    ("*", &["@dclass"]),
];

/// How a controller makes its force, which is limited all the same.
const ACTUATOR: &[&str] = &[
    "@name", "@group", "@user", "@actlimited", "@actrange", "@ctrlrange", "@ctrllimited", "@lengthrange", "@kp", "@kv", "@dampratio",
    "@timeconst", "@inheritrange", "@biastype", "@gaintype", "@dyntype", "@biasprm", "@gainprm", "@dynprm", "@actdim", "@actearly",
];
