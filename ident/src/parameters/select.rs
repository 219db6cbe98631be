//! Which parameters the `[fit]` table means.

use sim::Model;
use sim::model::Parameter;

use super::{FreeParameter, ParameterError, Parameters, Scale};
use crate::config::FitConfig;
use ground::names::{did_you_mean, glob};

/// A parameter of the model with the names it can be asked for by.
struct Candidate {
    name: String,
    place: Parameter,
    /// Whether a kind means it: a single name or glob always does.
    by_kind: bool,
}

impl Candidate {
    /// What kind it is: the last part of its name.
    fn kind(&self) -> &str {
        self.name.rsplit_once('/').map_or(&self.name, |(_, kind)| kind)
    }

    /// What may share a value with it: its kind, or the cause that it belongs to.
    fn likeness(&self) -> &str {
        match self.place {
            Parameter::Cause(..) => self.name.split_once('/').map_or(&self.name, |(cause, _)| cause),
            _ => self.kind(),
        }
    }

    fn is_kind(&self, kind: &str) -> bool {
        self.kind() == kind || kind == "fluidcoef" && matches!(self.place, Parameter::Fluid(..))
    }

    /// Whether a name, a glob or a kind means this parameter.
    fn is_meant(&self, pattern: &str) -> bool {
        glob(pattern, &self.name) || self.is_kind(pattern)
    }
}

impl Parameters {
    /// What `config` asks for, looked up in `model`.
    ///
    /// # Errors
    /// [`ParameterError`], for a name the model does not have or wishes that contradict each other.
    pub fn select(model: &Model, config: &FitConfig) -> Result<Self, ParameterError> {
        Self::select_with(model, config, &[])
    }

    /// The same, where `loose` says which joints turn freely in some run, driven ones too; those beyond its end do not.
    ///
    /// # Errors
    /// [`ParameterError`].
    pub(crate) fn select_with(
        model: &Model,
        config: &FitConfig,
        loose: &[bool],
    ) -> Result<Self, ParameterError> {
        let candidates = candidates(model, loose);
        let fitted = fitted(&candidates, config)?;
        let groups = groups(&candidates, &fitted, config)?;
        let mut free: Vec<FreeParameter> = Vec::new();
        for (at, candidate) in candidates.iter().enumerate().filter(|(at, _)| fitted[*at]) {
            let joined = |other: &usize| groups[at].is_some() && groups[*other] == groups[at];
            let mut members: Vec<&Candidate> = match groups[at] {
                Some(_) => (0..candidates.len()).filter(joined).map(|member| &candidates[member]).collect(),
                None => vec![candidate],
            };
            let shares = match groups[at] {
                Some(group) if group >= config.tie.len() => shares(model, &mut members)?,
                _ => vec![1.0; members.len()],
            };
            if members[0].place != candidate.place {
                continue;
            }
            let stated = |(member, share): (&&Candidate, &f64)| {
                config.prior.get(&member.name).and_then(|prior| prior.divided(*share))
            };
            let prior = members.iter().zip(&shares).find_map(stated);
            let value = prior.map_or(model.get(candidate.place), |prior| prior.mean.get());
            let scale = scale(model, candidate, value, config)?;
            free.push(FreeParameter {
                names: members.iter().map(|member| member.name.clone()).collect(),
                places: members.iter().map(|member| member.place).collect(),
                shares,
                start: scale.start(value),
                scale,
                prior,
            });
        }
        for parameter in &free {
            if let Some(mean) = parameter.prior.map(|prior| prior.mean.get()) {
                let (lower, upper) = (parameter.scale.lower(), parameter.scale.upper());
                if !(lower..=upper).contains(&mean) {
                    return Err(ParameterError::Prior { name: parameter.name().into(), mean, lower, upper });
                }
            }
        }
        Ok(Self { free })
    }
}

/// The error that `table` of the config names `name`, which means none of `candidates`.
fn unknown(candidates: &[Candidate], table: &'static str, name: &str) -> ParameterError {
    // a kind means that of passive joints
    let is_of_driven_joint = |candidate: &&Candidate| {
        let place = candidate.place;
        let of_joint =
            matches!(place, Parameter::Damping(_) | Parameter::FrictionLoss(_) | Parameter::Stiffness(..));
        of_joint && candidate.is_kind(name)
    };
    if let Some(driven) = candidates.iter().find(is_of_driven_joint) {
        let hint = format!(" (but of driven joints; ask for `{}` by name)", driven.name);
        return ParameterError::Unknown { table, name: name.to_owned(), hint };
    }
    let mut known: Vec<String> = if name.contains('/') {
        candidates.iter().map(|candidate| candidate.name.clone()).collect()
    } else {
        ["fluidcoef"].into_iter().chain(candidates.iter().map(Candidate::kind)).map(str::to_owned).collect()
    };
    known.sort();
    known.dedup();
    ParameterError::Unknown { table, name: name.to_owned(), hint: did_you_mean(name, &known) }
}

/// Whether `config` has each of `candidates` fitted.
fn fitted(candidates: &[Candidate], config: &FitConfig) -> Result<Vec<bool>, ParameterError> {
    let mut fitted = vec![false; candidates.len()];
    // The kinds fitted by default may be absent from a model; what somebody wrote may not.
    let is_default = config.parameters == FitConfig::default().parameters;
    for pattern in &config.parameters {
        let mut found = is_default;
        for (candidate, fitted) in candidates.iter().zip(&mut fitted) {
            let named = pattern.contains(['/', '*', '?']) && glob(pattern, &candidate.name);
            let by_kind = candidate.by_kind && candidate.is_kind(pattern);
            *fitted |= named || by_kind;
            found |= named || by_kind;
        }
        if !found {
            return Err(unknown(candidates, "parameters", pattern));
        }
    }
    for name in config.prior.keys() {
        let at = candidates.iter().position(|known| known.name == *name);
        fitted[at.ok_or_else(|| unknown(candidates, "prior", name))?] = true;
    }
    for pattern in &config.fixed {
        let mut found = false;
        for (candidate, fitted) in candidates.iter().zip(&mut fitted).filter(|(c, _)| c.is_meant(pattern)) {
            let contradiction = |first| {
                let name = candidate.name.clone();
                Err(ParameterError::Contradiction { name, first, second: "fixed" })
            };
            if config.parameters.contains(&candidate.name) {
                return contradiction("parameters");
            }
            if config.prior.contains_key(&candidate.name) {
                return contradiction("prior");
            }
            *fitted = false;
            found = true;
        }
        if !found {
            return Err(unknown(candidates, "fixed", pattern));
        }
    }
    if !config.fixed.is_empty() && !fitted.contains(&true) && !config.parameters.is_empty() {
        return Err(ParameterError::AllFixed);
    }
    for name in config.bounds.keys() {
        if !candidates.iter().any(|candidate| candidate.is_meant(name)) {
            return Err(unknown(candidates, "bounds", name));
        }
    }
    Ok(fitted)
}

/// Which group each of `candidates` belongs to: those of `config.tie`, then those of `config.proportional`.
fn groups(
    candidates: &[Candidate],
    fitted: &[bool],
    config: &FitConfig,
) -> Result<Vec<Option<usize>>, ParameterError> {
    let mut groups: Vec<Option<usize>> = vec![None; candidates.len()];
    let stated = config.tie.iter().map(|patterns| ("tie", patterns));
    let stated = stated.chain(config.proportional.iter().map(|patterns| ("proportional", patterns)));
    for (group, (key, patterns)) in stated.enumerate() {
        let mut first: Option<&Candidate> = None;
        for pattern in patterns {
            let meant: Vec<usize> =
                (0..candidates.len()).filter(|&at| candidates[at].is_meant(pattern)).collect();
            let Some(&any) = meant.first() else { return Err(unknown(candidates, key, pattern)) };
            // what is not fitted stays as it is, unless it is all that is meant
            if !meant.iter().any(|&at| fitted[at]) {
                return Err(ParameterError::JoinedButNotFitted { key, name: candidates[any].name.clone() });
            }
            for at in meant.into_iter().filter(|&at| fitted[at]) {
                let (candidate, name) = (&candidates[at], candidates[at].name.clone());
                if groups[at].is_some_and(|other| other != group) {
                    return Err(ParameterError::JoinedTwice { name });
                }
                let first = first.get_or_insert(candidate);
                if first.likeness() != candidate.likeness() {
                    return Err(ParameterError::JoinedUnlike {
                        key,
                        first: first.name.clone(),
                        second: name,
                    });
                }
                groups[at] = Some(group);
            }
        }
    }
    Ok(groups)
}

/// What the model has of each of `members`, as a share of what it has of the first; those that it has nothing of stay at 0 and leave.
fn shares(model: &Model, members: &mut Vec<&Candidate>) -> Result<Vec<f64>, ParameterError> {
    let all = members[0];
    members.retain(|member| model.get(member.place) != 0.0);
    let Some(first) = members.first() else {
        return Err(ParameterError::NoRatio { first: all.name.clone(), name: all.name.clone() });
    };
    let share = |member: &&Candidate| {
        let share = model.get(member.place) / model.get(first.place);
        let lost = || ParameterError::NoRatio { first: first.name.clone(), name: member.name.clone() };
        if share > 0.0 { Ok(share) } else { Err(lost()) }
    };
    members.iter().map(share).collect()
}

fn candidates(model: &Model, loose: &[bool]) -> Vec<Candidate> {
    let moves = |mut body: usize| {
        while body != 0 {
            if model.joints.iter().any(|joint| joint.body == body) {
                return true;
            }
            body = model.bodies[body].parent;
        }
        false
    };
    let passive = |joint: usize| !model.actuators.iter().any(|actuator| actuator.drives(joint));
    let candidate = |name: String| {
        let place = model.find_parameter(&name).ok()?;
        let by_kind = match place {
            Parameter::Fluid(geom, _) => moves(model.geoms[geom].body),
            Parameter::Damping(joint) => passive(joint) || loose.get(joint).is_some_and(|&loose| loose),
            Parameter::FrictionLoss(joint) | Parameter::Stiffness(joint, _) => passive(joint),
            Parameter::Mass(body) => moves(body),
            Parameter::Gain(_) | Parameter::Armature(_) => true,
            // a cause's parameters are fitted where somebody names them
            Parameter::Cause(..) => false,
        };
        Some(Candidate { name, place, by_kind })
    };
    model.parameter_names().into_iter().filter_map(candidate).collect()
}

/// Bounds by name, then by glob, by kind, by `fluidcoef`, then by what physics suggests.
fn scale(
    model: &Model,
    candidate: &Candidate,
    value: f64,
    config: &FitConfig,
) -> Result<Scale, ParameterError> {
    let stated = config
        .bounds
        .get_key_value(&candidate.name)
        .or_else(|| {
            config.bounds.iter().find(|(key, _)| key.contains(['*', '?']) && glob(key, &candidate.name))
        })
        .or_else(|| config.bounds.get_key_value(candidate.kind()))
        .or_else(|| config.bounds.get_key_value("fluidcoef").filter(|_| candidate.is_kind("fluidcoef")));
    let [lower, upper] = match stated {
        Some((name, bounds)) => {
            let [lower, upper] = bounds.map(|bound| bound.get());
            if lower >= upper {
                return Err(ParameterError::Bounds { name: name.clone(), lower, upper });
            }
            [lower, upper]
        }
        None => default_bounds(model, candidate, value),
    };
    let signed = match candidate.place {
        Parameter::Fluid(..) | Parameter::Stiffness(..) => true,
        Parameter::Cause(effect, place) => effect_bounds(model, effect, place)[0] < 0.0,
        _ => false,
    };
    if lower < 0.0 && !signed {
        let (name, kind) = (candidate.name.clone(), candidate.kind().to_owned());
        return Err(ParameterError::Negative { name, kind, lower });
    }
    Ok(match candidate.place {
        Parameter::Damping(_)
        | Parameter::FrictionLoss(_)
        | Parameter::Armature(_)
        | Parameter::Stiffness(..) => Scale::with_knee(lower, upper),
        Parameter::Fluid(..) | Parameter::Mass(_) | Parameter::Gain(_) | Parameter::Cause(..) => {
            Scale::new(lower, upper)
        }
    })
}

/// Fluid coefficients lie between 0 and 10 ([`FLUID_UPPER`]), masses within a factor of 2, gains of 10. A
/// joint's torque is bounded by what would all but stop the mechanism: with I its mass times its reach
/// squared, damping by I times 10 /s, armature by 10 I, friction loss by I times 100 /s2, stiffness by I times 1000 /s2; never
/// by less than 10 times `value`, the prior's mean or the model's own.
fn default_bounds(model: &Model, candidate: &Candidate, value: f64) -> [f64; 2] {
    let torque = |size: f64| size.max(10.0 * value.abs());
    let inertia = {
        let mass: f64 = model.bodies.iter().map(|body| body.mass).sum();
        mass * crate::geometry::characteristic_length_m(model).powi(2)
    };
    match candidate.place {
        Parameter::Fluid(..) => [0.0, FLUID_UPPER.max(2.0 * value)],
        Parameter::Damping(_) => [0.0, torque(10.0 * inertia)],
        Parameter::FrictionLoss(_) => [0.0, torque(100.0 * inertia)],
        Parameter::Armature(_) => [0.0, torque(10.0 * inertia)],
        Parameter::Stiffness(_, 0) => [0.0, torque(1000.0 * inertia)],
        Parameter::Stiffness(..) => [-torque(1000.0 * inertia), torque(1000.0 * inertia)],
        Parameter::Mass(_) => [0.5 * value, 2.0 * value],
        Parameter::Gain(_) => [0.1 * value, 10.0 * value],
        Parameter::Cause(effect, place) => effect_bounds(model, effect, place),
    }
}

/// What physics allows the parameter at `place` of the model's cause `effect`.
fn effect_bounds(model: &Model, effect: usize, place: usize) -> [f64; 2] {
    let parameter = model.causes()[effect].parameters().nth(place);
    parameter.map_or([f64::NEG_INFINITY, f64::INFINITY], |parameter| parameter.bounds)
}

/// Upper bound of a fluid coefficient where nobody says otherwise.
const FLUID_UPPER: f64 = 10.0;
