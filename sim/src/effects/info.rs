//! What every cause says about itself.

use crate::model::Model;

/// Where a cause sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// In the water or in the bodies.
    Physics,
    /// In the joints.
    Joint,
    /// Between the command and the drive.
    Drive,
    /// In a cable.
    Tether,
    /// In the camera or in what it is taken to see.
    Camera,
}

/// What part a parameter plays in its cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Role {
    /// How strong the cause is. At its neutral value the cause is absent and the motion's derivative by it is not 0: what
    /// a score test looks along.
    Size,
    /// 0 for absent, 1 for there; in between only to give a score test its direction.
    Switch,
    /// Shapes the cause and says nothing while the size is neutral: a search starts from each of these values.
    Hidden(&'static [f64]),
    /// One of these values, none in between.
    Choice(&'static [f64]),
    /// Stays as it is unless somebody names it.
    Detail,
}

/// What a parameter exists once for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Per {
    /// The model.
    Model,
    /// Each hinge and slide, after which it is called.
    Joint,
    /// Each body with mass, after which it is called.
    Body,
    /// Each geom with `fluidshape="ellipsoid"`, after which it is called.
    Geom,
    /// Each keypoint, after which it is called.
    Keypoint,
}

/// One parameter of a cause, or one family of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterInfo {
    /// Its name after the cause's; empty where each element lends its own ([`Self::per`]).
    pub name: &'static str,
    /// Unit, `1` for none.
    pub unit: &'static str,
    /// Least and greatest value that physics allows; a size that is never below 0 has one sign only.
    pub bounds: [f64; 2],
    /// Its value in a model that the cause was just added to: absent, or a good start.
    pub neutral: f64,
    /// A usual size: the scale of steps and weak priors.
    pub typical: f64,
    /// Its part.
    pub role: Role,
    /// What there is one of it for.
    pub per: Per,
    /// Whether each run has its own value, as the phase of waves does.
    pub per_run: bool,
    /// Says nothing where the choice of this name has this value.
    pub idle_where: Option<(&'static str, f64)>,
    /// What it is.
    pub meaning: &'static str,
}

impl ParameterInfo {
    /// A size, neutral at 0.
    pub(crate) const fn size(
        name: &'static str,
        unit: &'static str,
        bounds: [f64; 2],
        typical: f64,
        meaning: &'static str,
    ) -> Self {
        let (role, per) = (Role::Size, Per::Model);
        Self {
            name,
            unit,
            bounds,
            neutral: 0.0,
            typical,
            role,
            per,
            per_run: false,
            idle_where: None,
            meaning,
        }
    }

    /// The same, called after each element of a kind.
    pub(crate) const fn each(mut self, per: Per) -> Self {
        self.per = per;
        self
    }

    /// The same, in another part and with another neutral value.
    pub(crate) const fn role(mut self, role: Role, neutral: f64) -> Self {
        self.role = role;
        self.neutral = neutral;
        self
    }

    /// The same, without a say where the choice called `name` has `value`.
    pub(crate) const fn idle_where(mut self, name: &'static str, value: f64) -> Self {
        self.idle_where = Some((name, value));
        self
    }

    /// The same, with a value of its own in each run.
    pub(crate) const fn each_run(mut self) -> Self {
        self.per_run = true;
        self
    }
}

/// How MJCF holds a cause, so that MuJoCo moves with it too.
#[derive(Debug, Clone, Copy)]
pub struct Mjcf {
    /// Which attribute holds it, for the report.
    pub how: &'static str,
    /// Whether MuJoCo then moves exactly the same way.
    pub exact: fn(&super::Effect<f64>) -> bool,
    /// Writes the parameters' values into the model, in the order of [`Effect::values`](super::Effect::values).
    pub(crate) fold: fn(&super::Effect<f64>, &mut Model<f64>),
}

/// What a cause says about itself.
#[derive(Debug, Clone, Copy)]
pub struct Info {
    /// Its name, part of the contract.
    pub name: &'static str,
    /// Where it sits.
    pub kind: Kind,
    /// Its parameters.
    pub parameters: &'static [ParameterInfo],
    /// Causes that no video can tell from it, and when.
    pub aliases: &'static [Alias],
    /// A sentence for the report.
    pub sentence: &'static str,
    /// The term it adds.
    pub formula: &'static str,
    /// Where the term comes from, and its limits.
    pub source: &'static str,
    /// How MJCF holds it, if it can.
    pub mjcf: Option<Mjcf>,
    /// Whether its vectors lie in the picture's plane, x and z: a mechanism that moves in another plane then needs
    /// all of space.
    pub in_picture_plane: bool,
}

/// A cause that no video tells from this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alias {
    /// Its name.
    pub name: &'static str,
    /// When they are the same.
    pub when: AliasWhen,
}

/// When two causes are the same to any video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AliasWhen {
    /// Unless both weights, dry and wet, carry a prior.
    UnlessWeighed,
    /// Where no drop states its release: what is let go at an unknown time shows no clock.
    NoReleaseStated,
}
