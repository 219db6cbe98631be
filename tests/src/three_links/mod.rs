//! The paper's four cases: three links, passive from two poses and driven in two poses, in a mock tank that is not what the model says; filmed by
//! `rig run`, read by `rig extract`, identified on one passive and one driven case, predicted on the others: `docs/three-links.md`.

mod table;
mod tank;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use ident::diagnose::{Diagnosis, NamedCause};

use crate::verbs::{Result, verb};
use crate::{printed, set};

pub use table::{Rung, table};
pub use tank::{CommandForm, errors_by_the_tank_mm};

/// The mechanism, where a fit starts.
pub const MODEL: &str = include_str!("chain.xml");
/// The mechanism as it is in the tank.
const TANK_MODEL: &str = include_str!("tank.xml");
/// What the tank hides.
const TANK: &str = include_str!("tank.toml");
const PASSIVE: &str = include_str!("passive.toml");
const DRIVEN: &str = include_str!("driven.toml");
/// The tank's servo: it lags, as all do, and all rungs fit its lag.
const SERVO: &str = "actuator = \"servo\"\nus_per_rad = 636.61977\nlag_s = 0.02\nperiod_s = 0.001\n";
/// From pivot to pivot \[m\].
const LINK_M: f64 = 0.025;

/// One of the paper's cases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// Its name in files and in the experiment.
    pub id: &'static str,
    /// What the paper calls it.
    pub words: &'static str,
    /// Whether it is predicted and never fitted.
    pub held_out: bool,
    /// Angles of the hinges at the beginning \[rad\].
    pub pose_rad: [f64; 3],
    /// The angle that the servo swings about \[rad\]; none where nothing drives it.
    pub centre_rad: Option<f64>,
    /// The paper's mean errors of P1, P2 and P3 \[mm\].
    pub published_mm: [f64; 3],
}

/// All four: one of each configuration to fit, the other to predict.
pub const CASES: [Case; 4] = [
    Case {
        id: "passive-1",
        words: "passive, horizontal",
        held_out: false,
        pose_rad: [-std::f64::consts::FRAC_PI_2, 0.0, 0.0],
        centre_rad: None,
        published_mm: [0.87, 1.53, 2.79],
    },
    Case {
        id: "passive-2",
        words: "passive, right angle",
        held_out: true,
        pose_rad: [-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2, 0.0],
        centre_rad: None,
        published_mm: [1.35, 1.76, 2.54],
    },
    Case {
        id: "driven-1",
        words: "driven, pose I",
        held_out: false,
        pose_rad: [0.0; 3],
        centre_rad: Some(0.0),
        published_mm: [1.62, 2.78, 2.55],
    },
    Case {
        id: "driven-2",
        words: "driven, pose II",
        held_out: true,
        pose_rad: [0.5, -0.5, 0.0],
        centre_rad: Some(0.5),
        published_mm: [1.14, 1.97, 1.68],
    },
];

/// How keypoints are read from a picture: `[vision] mode`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reading {
    /// Equal thirds of the centreline, as published.
    Thirds,
    /// Rigid links fitted to the silhouette.
    Links,
}

impl Reading {
    fn mode(self) -> &'static str {
        match self {
            Self::Thirds => "paper",
            Self::Links => "links",
        }
    }
}

impl Case {
    /// Writes the case's tank and its rig config into `folder`, changed by `change`; the config's path.
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub fn write(&self, folder: &Path, change: impl FnOnce(&mut toml::Table)) -> Result<PathBuf> {
        std::fs::create_dir_all(folder)?;
        std::fs::write(folder.join("chain.xml"), MODEL)?;
        std::fs::write(folder.join("tank.xml"), TANK_MODEL)?;
        let mut tank: toml::Table = TANK.parse()?;
        tank.insert("initial_qpos".into(), self.pose_rad.to_vec().into());
        let mut config: toml::Table = match self.centre_rad {
            None => {
                tank.insert("hold".into(), "release".into());
                set(&mut tank, "release", "after_s", 1.0);
                PASSIVE.parse()?
            }
            Some(centre_rad) => {
                tank.insert("servo".into(), vec![toml::Value::Table(SERVO.parse()?)].into());
                let mut config = DRIVEN.parse()?;
                set(&mut config, "profile", "centre_rad", centre_rad);
                config
            }
        };
        let named = format!("{}-tank.toml", self.id);
        std::fs::write(folder.join(&named), tank.to_string())?;
        set(&mut config, "mock", "tank", named);
        set(&mut config, "run", "name", format!("Three links, {}", self.words));
        change(&mut config);
        let path = folder.join(format!("{}.toml", self.id));
        std::fs::write(&path, config.to_string())?;
        Ok(path)
    }

    /// Films the case of `config` into a run folder below `folder`; the run's folder.
    ///
    /// # Errors
    /// Where the run fails.
    pub fn film(&self, config: &Path, folder: &Path) -> Result<PathBuf> {
        let runs = folder.join(format!("{}-film", self.id));
        verb([
            "run".as_ref(),
            config.as_os_str(),
            "--film-only".as_ref(),
            "--runs-dir".as_ref(),
            runs.as_os_str(),
        ])?;
        crate::only_run(&runs).ok_or_else(|| format!("{} holds not exactly one run", runs.display()).into())
    }

    /// Reads keypoints from the film `run` into a run folder of the case's name below `folder`.
    ///
    /// # Errors
    /// Where nothing can be read.
    pub fn extract(&self, config: &Path, run: &Path, reading: Reading, folder: &Path) -> Result<()> {
        let mut table: toml::Table = std::fs::read_to_string(config)?.parse()?;
        set(&mut table, "vision", "mode", reading.mode());
        set(&mut table, "vision", "self_check", reading == Reading::Links);
        // what a run says of itself is not asked here
        set(&mut table, "fit", "parameters", vec!["q2/damping".to_owned()]);
        set(&mut table, "fit", "method", "least-squares");
        set(&mut table, "run", "diagnose", false);
        let own = config.with_file_name(format!("{}-{}.toml", self.id, reading.mode()));
        std::fs::write(&own, table.to_string())?;
        let out = folder.join(self.id);
        let to = ["--config".as_ref(), own.as_os_str(), "--out".as_ref(), out.as_os_str()];
        verb(["replay".as_ref(), run.as_os_str()].into_iter().chain(to))
    }
}

/// Writes [`MODEL`] to `path` with its keypoints where thirds of the centreline have them in the straight chain of pose I, as extracted into `folder`: a
/// skeleton ends before the mechanism does, so that they are neither pivots nor tip.
///
/// # Errors
/// Where the case is not there.
pub fn write_thirds_model(folder: &Path, path: &Path) -> Result<()> {
    /// Images at the beginning, at rest.
    const IMAGES: usize = 20;
    let still = ident::table::read_trajectory(&folder.join("driven-1/trajectory.csv"))?;
    let mut lines: Vec<String> =
        MODEL.lines().filter(|line| !line.contains("<site name")).map(str::to_owned).collect();
    for (column, name) in still.keypoints.iter().enumerate() {
        let rows = 0..IMAGES.min(still.time_s.len());
        let height_m = rows.clone().map(|row| still.at(row, column)[2]).sum::<f64>() / rows.len() as f64;
        let link = ((height_m / LINK_M) as usize).min(2);
        let beyond_m = height_m - LINK_M * link as f64;
        let geom = format!("name=\"g{}\"", link + 1);
        let place = lines.iter().position(|line| line.contains(&geom)).ok_or("the model has no such geom")?;
        lines.insert(place + 1, format!("<site name=\"{name}\" pos=\"0 0 {beyond_m:.6}\"/>"));
    }
    Ok(std::fs::write(path, lines.join("\n"))?)
}

/// Writes the experiment `name` of what was extracted into `folder`: `model` as seen from there, fitted by `method`, with the causes' parameters
/// `beside` the usual ones; its path.
///
/// # Errors
/// Where it cannot be written.
pub fn write_experiment(
    folder: &Path,
    name: &str,
    model: &str,
    method: &str,
    beside: &[String],
) -> Result<PathBuf> {
    let mut experiment = toml::Table::new();
    experiment.insert("model".into(), model.into());
    experiment.insert("prescribed".into(), true.into());
    let mut parameters: Vec<String> =
        ["fluidcoef", "damping", "frictionloss", "q1/frictionloss", "servo_lag/time"]
            .map(str::to_owned)
            .to_vec();
    parameters.extend_from_slice(beside);
    set(&mut experiment, "fit", "parameters", parameters);
    set(&mut experiment, "fit", "method", method);
    let runs = CASES.map(|case| {
        let mut run = toml::Table::new();
        let mut put = |key: &str, value: String| run.insert(key.into(), value.into());
        put("id", case.id.into());
        put("kind", if case.centre_rad.is_some() { "driven" } else { "drop" }.into());
        put("trajectory", format!("{}/trajectory.csv", case.id));
        if case.centre_rad.is_some() {
            put("servo", format!("{}/servo.csv", case.id));
        }
        put("use", if case.held_out { "holdout" } else { "fit" }.into());
        toml::Value::Table(run)
    });
    experiment.insert("run".into(), runs.to_vec().into());
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, experiment.to_string())?;
    Ok(path)
}

/// The causes that extend the model: those named, or, where not all is explained, those established.
pub fn named(diagnosis: &Diagnosis) -> &[NamedCause] {
    if diagnosis.causes.is_empty() { &diagnosis.established } else { &diagnosis.causes }
}

/// Their parameters, as `[fit] parameters` names them.
pub fn parameters(causes: &[NamedCause]) -> Vec<String> {
    let all = causes.iter().flat_map(|cause| &cause.parameters);
    let mut names: Vec<String> =
        all.map(|parameter| parameter.name.split('@').next().unwrap_or_default().to_owned()).collect();
    names.dedup();
    names
}

/// Mean distance by which noise alone moves P1, P2 and P3 of `case` \[mm\]: as the trajectory in `folder` states it, else as the diagnosis found it.
///
/// # Errors
/// Where there is no trajectory.
pub fn noise_mm(case: &Case, folder: &Path, diagnosis: &Diagnosis) -> Result<Option<[f64; 3]>> {
    let trajectory = ident::table::read_trajectory(&folder.join(case.id).join("trajectory.csv"))?;
    let stated = trajectory.std_m.as_ref().map(|std_m| {
        // P0 stands before the others where it was seen
        let width = trajectory.keypoints.len();
        let column = |name: &str| trajectory.keypoints.iter().position(|keypoint| keypoint == name);
        ["P1", "P2", "P3"].map(|name| {
            let cells = std_m.iter().skip(column(name).unwrap_or(0)).step_by(width);
            let squares: Vec<f64> = cells.filter(|std| std.is_finite()).map(|std| std * std).collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        })
    });
    let found = || -> Option<[f64; 3]> {
        let runs = &diagnosis.noise.runs;
        // a run that is not fitted was read like the others
        let run = runs.iter().find(|run| run.id == case.id).or(runs.first())?;
        run.std_m.clone().try_into().ok()
    };
    // the mean distance of what is normal along two axes
    let mean_mm = |std_m: [f64; 3]| std_m.map(|std_m| 1e3 * std_m * std::f64::consts::FRAC_PI_2.sqrt());
    Ok(stated.or_else(found).map(mean_mm))
}

/// Has MuJoCo move the tanks described in `rig`, their servos as those of the runs extracted into `links`, and write keypoints into `folder`.
///
/// # Errors
/// Where `python` has no mujoco.
pub fn in_mujoco(python: &OsStr, rig: &Path, links: &Path, folder: &Path) -> Result<()> {
    for case in CASES {
        std::fs::create_dir_all(folder.join(case.id))?;
        if case.centre_rad.is_some() {
            let servo = Path::new(case.id).join("servo.csv");
            std::fs::copy(links.join(&servo), folder.join(&servo))?;
        }
    }
    let script = crate::repository().join("scripts/three-links-mujoco");
    let output = Command::new(python).arg(script).args([rig, folder]).output()?;
    if output.status.success() { Ok(()) } else { Err(printed(&output).into()) }
}
