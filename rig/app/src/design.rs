//! The runs that a rig could make next, and their configs.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context as _, anyhow};
use ground::strict::Positive;
use ident::design::runs::{Motion, Proposal};
use ident::diagnose::NextExperiment;
use ident::experiment::DesignConfig;

use super::{Failure, base};
use config::paths;
use ground::shell;
use record::outputs::OutputFolder;
use servo::ServoConfig;
use servo::profile::{Profile, ProfileConfig};

/// Duration of a proposed run at most \[s\]. Chosen.
const PROPOSED_RUN_MAX_S: f64 = 30.0;
/// Factor on the limits of a servo, as a margin for rounding to whole microseconds or counts. Chosen.
const LIMIT_MARGIN_FACTOR: f64 = 0.995;

/// The runs that a rig with this servo could make: within its travel and its rate, and no shorter than its profile.
pub(super) fn limits(servo: Option<&ServoConfig>, profile: Option<&ProfileConfig>) -> DesignConfig {
    let mut design = DesignConfig::default();
    let (Some(servo), Some(profile)) = (servo, profile) else { return design };
    design.centre_rad = profile.centre_rad;
    let centre_rad = profile.centre_rad.get();
    let at_most = |limit: &mut Positive, value: f64| {
        if let Some(value) =
            Positive::new(LIMIT_MARGIN_FACTOR * value).filter(|value| value.get() < limit.get())
        {
            *limit = value;
        }
    };
    for (channel, _) in servo.driven() {
        let (travel, mirrored) = (&channel.travel, profile.is_mirrored());
        let angle_rad = |setpoint: u16| channel.angle_rad(f64::from(setpoint), mirrored);
        let (least, greatest) = (*travel.range().start(), *travel.range().end());
        for end in [least, greatest] {
            at_most(&mut design.amplitude_limit_rad, (angle_rad(end) - centre_rad).abs());
        }
        let per_rad = f64::from(greatest - least) / (angle_rad(greatest) - angle_rad(least)).abs();
        if travel.max_rate_per_s() > 0 {
            at_most(&mut design.rate_limit_rad_per_s, f64::from(travel.max_rate_per_s()) / per_rad);
        }
    }
    let profile_s = Profile::new(profile).map_or(0.0, |profile| profile.duration_s());
    if let Some(run_s) = Positive::new(profile_s.clamp(design.run_s.get(), PROPOSED_RUN_MAX_S)) {
        design.run_s = run_s;
    }
    design
}

/// Patterns of the files that [`write_configs`] writes.
pub const CONFIGS: [&str; 2] = ["drop-*.toml", "driven-*.toml"];

/// Writes a config for each of `next` to `folder`: `config` with another motion.
///
/// # Errors
/// [`Failure::Input`] where `config` cannot be read, [`Failure::Internal`] where the folder cannot be written.
pub fn write_configs(config: &Path, next: &[Proposal], folder: &OutputFolder) -> Result<(), Failure> {
    let reading = || format!("reading the rig's config {}", config.display());
    let text = std::fs::read_to_string(config).with_context(reading).map_err(Failure::Input)?;
    let mut table: toml::Table = text.parse().with_context(reading).map_err(Failure::Input)?;
    let origin = std::path::absolute(config).with_context(reading).map_err(Failure::Input)?;
    paths::make_absolute(&mut table, base(&origin));
    folder.create().map_err(Failure::internal)?;
    let mut written = BTreeSet::new();
    for proposal in next.iter().filter(|proposal| written.insert(proposal.id.clone())) {
        let config = changed(&table, proposal)?;
        let text = format!("# Proposed by rig design: {}.\n{config}", proposal.words());
        folder.write(&format!("{}.toml", proposal.id), text.as_bytes()).map_err(Failure::internal)?;
    }
    Ok(())
}

/// Adds to `advice` the command that makes each run whose config is in `folder`.
pub fn add_commands(advice: &mut [NextExperiment], folder: &Path) {
    NextExperiment::to_type(advice, |run| Some(shell::run(&folder.join(format!("{run}.toml")))));
}

fn changed(base: &toml::Table, proposal: &Proposal) -> Result<toml::Table, Failure> {
    let mut config = base.clone();
    let run = config.get_mut("run").and_then(toml::Value::as_table_mut);
    let run = run.ok_or_else(|| Failure::Input(anyhow!("the rig's config has no [run] table")))?;
    run.insert("name".into(), format!("Next: {}", proposal.words()).into());
    run.insert("kind".into(), proposal.kind().into());
    match proposal.motion {
        Motion::Drop { .. } => {
            run.insert("film_s".into(), proposal.seconds.into());
            config.remove("profile");
        }
        Motion::Driven { amplitude_rad, ccw_s, cw_s } => {
            let mut profile =
                config.get("profile").and_then(toml::Value::as_table).cloned().unwrap_or_default();
            for (key, number) in [("amplitude_rad", amplitude_rad), ("ccw_s", ccw_s), ("cw_s", cw_s)] {
                profile.insert(key.into(), number.into());
            }
            profile.insert("cycles".into(), i64::from(proposal.cycles()).into());
            profile.insert("soft_start_cycles".into(), 0.into());
            config.insert("profile".into(), profile.into());
        }
    }
    Ok(config)
}
