//! Questions on a terminal, each for one option of `rig new`; answers are checked as they come.

use std::io::{BufRead, Write};

use clap::{ArgMatches, Args as _, FromArgMatches as _};

use crate::setup::{Answers, Chain, Drive, Scale, Shape};
use config::{MotionKind, Mount};

/// Devices that could be used.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub(super) ports: Vec<String>,
    pub(super) cameras: Vec<String>,
    /// Nothing is plugged in, and nothing was said about it: a mock rig is offered.
    pub(super) may_be_mock: bool,
}

/// What is asked of a mock rig, by the options that they stand for; all else has a default that the files show.
const ASKED_OF_A_MOCK: [&str; 2] = ["links", "motion"];

struct Question {
    /// The option that it stands for.
    option: &'static str,
    text: &'static str,
    /// Whether the option was given.
    given: fn(&Answers) -> bool,
    /// What holds where nothing is answered.
    default: fn(&Chain) -> String,
    /// Whether it matters, after what was answered before.
    matters: fn(&Answers, &Chain) -> bool,
}

macro_rules! question {
    ($field:ident, $option:literal, $text:literal, $default:expr) => {
        question!($field, $option, $text, $default, |_, _| true)
    };
    ($field:ident, $option:literal, $text:literal, $default:expr, $matters:expr) => {
        Question {
            option: $option,
            text: $text,
            given: |answers| answers.$field.is_some(),
            default: $default,
            matters: $matters,
        }
    };
}

/// In this order: a later answer's default follows from the earlier ones.
const QUESTIONS: [Question; 22] = [
    question!(links, "links", "number of links", |chain| chain.links.len().to_string()),
    question!(length_m, "length-m", "length of a link, end to end [m]", |chain| rounded(chain.length_m)),
    question!(overlap_m, "overlap-m", "overlap of two links at their pivot [m]", |chain| rounded(
        chain.overlap_m
    )),
    question!(width_m, "width-m", "width of a link as the camera sees it [m]", |chain| rounded(
        chain.width_m
    )),
    question!(thickness_m, "thickness-m", "thickness of a link along the camera's view [m]", |chain| {
        rounded(chain.thickness_m)
    }),
    question!(shape, "shape", "shape of a link: box or ellipsoid", |chain| match chain.shape {
        Shape::Box => "box".into(),
        Shape::Ellipsoid => "ellipsoid".into(),
    }),
    question!(
        mount,
        "mount",
        "mounted hanging, upright (motor at the bottom) or horizontal (filmed from above)",
        |chain| match chain.mount {
            Mount::Hanging => "hanging".into(),
            Mount::Upright => "upright".into(),
            Mount::Horizontal => "horizontal".into(),
        }
    ),
    question!(motion, "motion", "driven (by a servo) or drop (let go by hand)", |chain| chain
        .motion
        .to_string()),
    question!(water_temperature_c, "water-temperature-c", "temperature of the water [degC]", |chain| {
        chain.water_temperature_c.to_string()
    }),
    question!(salinity_g_per_kg, "salinity-g-per-kg", "salinity of the water [g/kg]", |chain| chain
        .salinity_g_per_kg
        .to_string()),
    question!(
        dry_mass_kg,
        "dry-mass-kg",
        "weight in air of a link, or of each with commas between [kg]; nothing: a density",
        nothing,
        |answers, _| answers.density_kg_per_m3.is_none()
    ),
    question!(
        wet_mass_kg,
        "wet-mass-kg",
        "weight in water of a link, or of each, negative where it floats [kg]; nothing: by its shape",
        nothing,
        |answers, _| answers.dry_mass_kg.is_some()
    ),
    question!(
        balance_std_kg,
        "balance-std-kg",
        "standard deviation of the balance [kg]",
        |chain| chain.balance_std_kg.to_string(),
        |answers, _| answers.dry_mass_kg.is_some()
    ),
    question!(
        density_kg_per_m3,
        "density-kg-per-m3",
        "density of the links [kg/m3]",
        |chain| chain.density_kg_per_m3.to_string(),
        |answers, _| answers.dry_mass_kg.is_none()
    ),
    question!(
        port,
        "port",
        "serial port of the servo board",
        |chain| match &chain.drive {
            Drive::Real { port, .. } => port.clone(),
            Drive::Mock => String::new(),
        },
        |_, chain| chain.motion == MotionKind::Driven
    ),
    question!(device, "device", "camera", |chain| match &chain.drive {
        Drive::Real { device, .. } => device.clone(),
        Drive::Mock => String::new(),
    }),
    question!(format, "format", "images leave the camera as grey, yuyv or jpeg", |chain| format!(
        "{:?}",
        chain.picture.format
    )
    .to_lowercase()),
    question!(size_px, "size-px", "width x height of the images [px]", |chain| {
        let [width, height] = chain.picture.size_px;
        format!("{width}x{height}")
    }),
    question!(fps, "fps", "images a second", |chain| chain.picture.fps.to_string()),
    question!(exposure_s, "exposure-s", "exposure time [s]", |chain| chain.picture.exposure_s.to_string()),
    question!(
        calibration,
        "calibration",
        "calibration file by `rig calibrate camera`; nothing: a scale, or none yet",
        nothing,
        |answers, _| answers.metres_per_pixel.is_none()
    ),
    question!(
        metres_per_pixel,
        "metres-per-pixel",
        "scale in the plane of motion [m/px]; not measured yet: a guess that fills the picture",
        |chain| match chain.picture.scale {
            Scale::Square { metres_per_pixel, .. } => rounded(metres_per_pixel),
            Scale::File(_) => String::new(),
        },
        |answers, _| answers.calibration.is_none()
    ),
];

fn nothing(_: &Chain) -> String {
    String::new()
}

/// A length without the digits that only a division made.
fn rounded(length_m: f64) -> String {
    ((length_m * 1e7).round() / 1e7).to_string()
}

/// Why nothing came of the questions.
#[derive(Debug, thiserror::Error)]
pub(super) enum AskError {
    #[error(transparent)]
    Terminal(#[from] std::io::Error),
    #[error("the answers ended before the last question; nothing was written")]
    Ended,
    #[error("the options given do not go together")]
    Options(#[from] crate::setup::Refusal),
}

/// Asks whatever `given` does not say, on `prompts`, until each answer can be.
pub(super) fn ask(
    given: &Answers,
    found: &Found,
    typed: &mut dyn BufRead,
    prompts: &mut dyn Write,
) -> Result<Answers, AskError> {
    let mut answers = given.clone();
    writeln!(
        prompts,
        "What is between brackets holds where nothing is answered. Units are SI; Ctrl-C writes nothing."
    )?;
    answers.mock = given.mock || found.may_be_mock && is_to_be_mock(typed, prompts)?;
    for (devices, answer) in [(&found.ports, &mut answers.port), (&found.cameras, &mut answers.device)] {
        if !answers.mock && answer.is_none() {
            // Only a default so far: it is asked about all the same.
            *answer = devices.first().cloned();
        }
    }
    let mut chain = Chain::new(&answers)?;
    for question in QUESTIONS.iter().filter(|question| !(question.given)(given)) {
        let is_asked = !answers.mock || ASKED_OF_A_MOCK.contains(&question.option);
        if !is_asked || !(question.matters)(&answers, &chain) {
            continue;
        }
        let devices: &[String] = match question.option {
            "port" => &found.ports,
            "device" => &found.cameras,
            _ => &[],
        };
        for device in devices {
            writeln!(prompts, "  found {device}")?;
        }
        (answers, chain) = loop {
            let line = answer(question.text, &(question.default)(&chain), typed, prompts)?;
            let checked = match line.as_str() {
                "" => break (answers, chain),
                text => with(&answers, question.option, text),
            };
            match checked.and_then(|answers| Ok((Chain::new(&answers).map_err(|e| e.to_string())?, answers)))
            {
                Ok((chain, answers)) => break (answers, chain),
                Err(why) => writeln!(prompts, "  {why}")?,
            }
        };
    }
    Ok(answers)
}

/// Asks for a mock rig or a real one, where nothing is plugged in.
fn is_to_be_mock(typed: &mut dyn BufRead, prompts: &mut dyn Write) -> Result<bool, AskError> {
    let question = "nothing is plugged in: a mock rig in a simulated tank, or a real one: mock or real";
    loop {
        match answer(question, "mock", typed, prompts)?.as_str() {
            "" | "mock" => return Ok(true),
            "real" => return Ok(false),
            other => writeln!(prompts, "  `{other}` is neither mock nor real")?,
        }
    }
}

/// What is answered to a question, without the white space around it.
fn answer(
    question: &str,
    default: &str,
    typed: &mut dyn BufRead,
    prompts: &mut dyn Write,
) -> Result<String, AskError> {
    write!(prompts, "{question} [{default}]: ")?;
    prompts.flush()?;
    let mut line = String::new();
    match typed.read_line(&mut line)? {
        0 => Err(AskError::Ended),
        _ => Ok(line.trim().to_owned()),
    }
}

/// The options of `rig new` as the command line reads them.
fn read(arguments: &[&str]) -> Result<ArgMatches, String> {
    let command = Answers::augment_args(clap::Command::new("new").no_binary_name(true));
    command.try_get_matches_from(arguments).map_err(|error| {
        let text = error.to_string();
        let first = text.lines().next().unwrap_or_default();
        first.trim_start_matches("error: ").to_owned()
    })
}

/// `answers` with what was answered for `option`.
fn with(answers: &Answers, option: &str, text: &str) -> Result<Answers, String> {
    let matches = read(&[&format!("--{option}={text}")])?;
    let mut answers = answers.clone();
    let mock = answers.mock;
    answers.update_from_arg_matches(&matches).map_err(|error| error.to_string())?;
    answers.mock = mock;
    Ok(answers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(given: &[&str], typed: &str) -> (Result<Answers, AskError>, String) {
        let ports = vec!["/dev/ttyACM3".into()];
        asked_where(&Found { ports, ..Found::default() }, given, typed)
    }

    fn asked_where(found: &Found, given: &[&str], typed: &str) -> (Result<Answers, AskError>, String) {
        let given = Answers::from_arg_matches(&read(given).unwrap()).unwrap();
        let mut prompts = Vec::new();
        let answers = ask(&given, found, &mut typed.as_bytes(), &mut prompts);
        (answers, String::from_utf8(prompts).unwrap())
    }

    #[test]
    fn defaults_hold_where_nothing_is_answered_and_options_are_not_asked() {
        let (answers, prompts) = asked(&["--links=4", "--fps=30"], &"\n".repeat(30));
        let answers = answers.unwrap();
        assert_eq!(answers.port.as_deref(), Some("/dev/ttyACM3"));
        assert_eq!(Chain::new(&answers).unwrap().links.len(), 4);
        assert!(!prompts.contains("number of links") && !prompts.contains("images a second"), "{prompts}");
        assert!(prompts.contains("length of a link, end to end [m] [0.03]: "), "{prompts}");
        assert!(prompts.contains("overlap of two links at their pivot [m] [0.005]: "), "{prompts}");
        assert!(
            prompts.contains("found /dev/ttyACM3\nserial port of the servo board [/dev/ttyACM3]: "),
            "{prompts}"
        );
    }

    #[test]
    fn an_answer_that_cannot_be_is_asked_again_at_once() {
        let typed = ["two", "2", "0.1", "0.1", "0.01", "", "", "", "", "drop"].join("\n") + &"\n".repeat(20);
        let (answers, prompts) = asked(&[], &typed);
        let answers = answers.unwrap();
        assert_eq!((answers.links, answers.length_m, answers.overlap_m), (Some(2), Some(0.1), Some(0.01)));
        assert_eq!(answers.motion, Some(MotionKind::Drop));
        assert!(prompts.contains("invalid value 'two' for '--links"), "{prompts}");
        assert!(prompts.contains("--overlap-m 0.1 must be less than --length-m 0.1"), "{prompts}");
        assert_eq!(prompts.matches("number of links").count(), 2);
        assert!(!prompts.contains("serial port"), "nobody drives it: {prompts}");
    }

    #[test]
    fn weights_are_asked_in_water_only_once_they_are_known_in_air() {
        let (answers, prompts) = asked(&["--dry-mass-kg=0.0018"], &"\n".repeat(30));
        assert_eq!(answers.unwrap().dry_mass_kg, Some(vec![0.0018]));
        assert!(
            prompts.contains("weight in water") && !prompts.contains("density of the links"),
            "{prompts}"
        );
        let (_, prompts) = asked(&[], &"\n".repeat(30));
        assert!(
            !prompts.contains("weight in water") && prompts.contains("density of the links"),
            "{prompts}"
        );
    }

    #[test]
    fn where_nothing_is_plugged_in_three_questions_make_a_mock_rig() {
        let bare = Found { may_be_mock: true, ..Found::default() };
        let (answers, prompts) = asked_where(&bare, &[], "simulated\n\n2\ndrop\n");
        let answers = answers.unwrap();
        assert!(answers.mock && answers.links == Some(2) && answers.motion == Some(MotionKind::Drop));
        assert!(prompts.contains("`simulated` is neither mock nor real"), "{prompts}");
        assert_eq!(prompts.matches("]: ").count(), 4, "one of them twice: {prompts}");
        let (answers, prompts) =
            asked_where(&bare, &["--links=3"], &("real\n".to_owned() + &"\n".repeat(30)));
        assert!(!answers.unwrap().mock && prompts.contains("serial port"), "{prompts}");
        let (_, prompts) = asked(&["--mock"], &"\n".repeat(30));
        assert_eq!(prompts.matches("]: ").count(), 2, "{prompts}");
    }

    #[test]
    fn answers_that_end_early_make_nothing() {
        assert!(matches!(asked(&[], "3\n0.03\n").0, Err(AskError::Ended)));
        assert!(matches!(asked(&["--overlap-m=1"], "\n").0, Err(AskError::Options(_))));
    }
}
