"""Elements and values that MJCF no longer has, or never had, and their replacements, from MuJoCo's changelog."""

FLEXCOMP = 'use <flexcomp type="grid" dim="1" …> with <elasticity young=… shear=…/> or <edge equality="true"/>'

# The version without the element, alone or in its parent, and the remedy.
REMOVED_ELEMENTS = {
    "composite": ("in MuJoCo 4.0.0", f"{FLEXCOMP}; cloth and soft bodies are <flexcomp> of dim 2 and 3"),
    "flexvert": (
        "in MuJoCo 4.0.0",
        'use continuum <elasticity> with integrator="discrete", or <edge equality="true"/> for cloth',
    ),
    "equality/distance": (
        "in MuJoCo 2.2.2",
        "connect sites of both bodies by a <spatial> tendon, and keep its length by <tendon> in <equality>",
    ),
}

REMOVED_PLUGINS = {
    "mujoco.elasticity.cable": ("in MuJoCo 4.0.0", FLEXCOMP),
    "mujoco.elasticity.shell": ("in MuJoCo 3.3.3", 'use <flexcomp dim="2"> with <elasticity>'),
    "mujoco.elasticity.solid": ("in MuJoCo 3.2.4", 'use <flexcomp dim="3"> with <elasticity>'),
    "mujoco.elasticity.membrane": ("in MuJoCo 3.2.4", 'use <flexcomp dim="2"> with <elasticity>'),
    "mujoco.sdf.sdflib": ("in MuJoCo 3.3.5", 'use a separate mesh: <geom type="sdf" mesh=…>'),
}

# The version without the attribute of an element, and the remedy.
REMOVED_ATTRIBUTES = {
    ("option", "collision"): (
        "in MuJoCo 3.0.0",
        'delete collision="all"; for "predefined" write <default><geom contype="0" conaffinity="0"/></default>',
    ),
    ("option", "apirate"): ("in MuJoCo 3.3.7", "delete it; it had no effect"),
    ("option", "mpr_iterations"): ("in MuJoCo 3.2.3", "write ccd_iterations"),
    ("option", "mpr_tolerance"): ("in MuJoCo 3.2.3", "write ccd_tolerance"),
    ("compiler", "convexhull"): ("in MuJoCo 3.2.5", "delete it; convex hulls are made where they are needed"),
    ("compiler", "exactmeshinertia"): ("in MuJoCo 3.2.5", 'write <mesh inertia="exact"> on the meshes that need it'),
    ("joint", "actuatorforcerange"): ("in MuJoCo 3.0.0", "write actuatorfrcrange"),
    ("joint", "actuatorforcelimited"): ("in MuJoCo 3.0.0", "write actuatorfrclimited"),
    ("camera", "orthographic"): ("in MuJoCo 3.5.0", 'write projection="orthographic"'),
    ("flag", "passive"): ("in MuJoCo 3.3.6", "write spring and damper"),
    ("flag", "sensornoise"): ("in MuJoCo 3.1.4", "delete it; add noise where sensors are read"),
    ("contact", "internal"): ("in MuJoCo 3.15.0", "write selfcollide"),
}

# Attributes that have another name now, and values that are written as other attributes, or no longer needed.
RENAMED_ATTRIBUTES = {
    ("option", "mpr_iterations"): "ccd_iterations",
    ("option", "mpr_tolerance"): "ccd_tolerance",
    ("joint", "actuatorforcerange"): "actuatorfrcrange",
    ("joint", "actuatorforcelimited"): "actuatorfrclimited",
}
REWRITTEN_VALUES: dict[tuple[str, str, str], dict[str, str]] = {
    ("option", "collision", "all"): {},
    ("compiler", "convexhull", "true"): {},
    ("compiler", "convexhull", "false"): {},
    ("compiler", "exactmeshinertia", "false"): {},
    ("flag", "sensornoise", "enable"): {},
    ("flag", "sensornoise", "disable"): {},
    ("flag", "passive", "enable"): {},
    ("flag", "passive", "disable"): {"spring": "disable", "damper": "disable"},
    ("camera", "orthographic", "true"): {"projection": "orthographic"},
    ("camera", "orthographic", "false"): {"projection": "perspective"},
    ("contact", "internal", "false"): {},
}
# The fields of the compiled model on which they act, where MuJoCo ignores what it does not know, as in <frame>.
REWRITTEN_FIELDS = {"joint": ("jnt_actfrc*",), "camera": ("cam_projection",)}


def rewritten(tag: str, attribute: str, value: str) -> dict[str, str] | None:
    """Returns the attributes that replace a removed one; None if that is not certain."""
    if name := RENAMED_ATTRIBUTES.get((tag, attribute)):
        return {name: value}
    if (tag, attribute) == ("option", "apirate"):
        return {}
    return REWRITTEN_VALUES.get((tag, attribute, value))


# The version without the value of an attribute, and the remedy.
REMOVED_VALUES = {
    ("edge", "equality", "vert"): ("in MuJoCo 4.0.0", REMOVED_ELEMENTS["flexvert"][1]),
    ("compiler", "coordinate", "global"): (
        "in MuJoCo 2.3.4",
        "load and save the model in MuJoCo 2.3.3 to convert it to local coordinates",
    ),
}

# Keywords of MJCF, and words of other formats and languages with the same meaning.
SYNONYMS = {
    "true": ("yes", "on", "1", "enabled"),
    "enable": ("yes", "on", "1", "true"),
    "false": ("no", "off", "0", "disabled"),
    "disable": ("no", "off", "0", "false"),
    "radian": ("rad",),
    "degree": ("deg",),
    "box": ("cube", "cuboid"),
    "sphere": ("ball",),
    "capsule": ("rod",),
    "cylinder": ("tube",),
    "plane": ("ground",),
    "hinge": ("revolute", "continuous"),
    "slide": ("prismatic", "linear"),
    "ball": ("spherical",),
    "free": ("floating",),
    "directional": ("sun",),
    "RK4": ("rungekutta",),
    "PGS": ("gauss-seidel",),
}

# Elements that MJCF never had, but that people write.
FOREIGN_ELEMENTS = {
    "solver": 'the solver is chosen in <option>: <option solver="Newton" iterations="100" tolerance="1e-8"/>',
    "world": "the world is called <worldbody>",
    "restitution": 'MJCF has none; for bouncing, lower the damping: <geom solref="-STIFFNESS -DAMPING">',
    "gravity": 'gravity is an option: <option gravity="0 0 -9.81"/>',
    "physics": 'physics is in <option>: <option timestep="0.002" gravity="0 0 -9.81"/>',
    "link": "a link is a <body>, with its <geom> and <joint> inside",
    "robot": "a file with <robot> as its root is URDF and needs the suffix .urdf",
    "collision": "a <geom> collides; contype and conaffinity say with what",
    "visual": 'a geom that is only seen is <geom contype="0" conaffinity="0">; <visual> is for rendering options',
    "actuators": "write <actuator>, directly in <mujoco>",
    "sensors": "write <sensor>, directly in <mujoco>",
}
