//! Models, configs and experiments.

use std::path::Path;

use config::RigConfig;
use ident::experiment::Experiment;
use sim::Model;
use sim::causes::own::{Acts, OwnCause, OwnParameter, Place};

/// A model that is read can be written, and then says the same to the bit.
fn written_again(model: &Model) {
    let written = model.to_mjcf("");
    let again = Model::from_mjcf(&written).unwrap_or_else(|error| panic!("{error}:\n{written}")).to_mjcf("");
    assert_eq!(again, written);
}

/// A model in one text.
pub(crate) fn mjcf(bytes: &[u8]) -> bool {
    Model::from_mjcf(&crate::text(bytes)).iter().inspect(|model| written_again(model)).count() > 0
}

/// A model and a file for it to include, `part.xml`, behind a zero byte: includes end, and lead nowhere else.
pub(crate) fn mjcf_include(bytes: &[u8]) -> bool {
    let mut texts = bytes.splitn(2, |&byte| byte == 0);
    let (model, part) = (texts.next().unwrap_or_default(), texts.next().unwrap_or_default());
    crate::files::in_a_folder(|folder| {
        let path = folder.join("model.xml");
        crate::files::put(&path, model);
        crate::files::put(&folder.join("part.xml"), part);
        Model::read_mjcf(&path).iter().inspect(|model| written_again(model)).count() > 0
    })
}

/// A rig's config.
pub(crate) fn config(bytes: &[u8]) -> bool {
    let Ok(config) = RigConfig::parse(&crate::text(bytes), Path::new("rig.toml")) else { return false };
    let rate = config.camera_bytes_per_s();
    assert!(rate >= 0.0, "{rate} bytes a second");
    config.expected_bytes();
    true
}

/// The torque of a cause of one's own on a pendulum's hinge: an expression that is taken has numbers at any angle.
pub(crate) fn expression(bytes: &[u8]) -> bool {
    const PENDULUM: &str = r#"<mujoco><worldbody><body><joint name="hinge" axis="0 -1 0"/>
        <geom type="sphere" size="0.01" pos="0 0 -0.1"/></body></worldbody></mujoco>"#;
    let mut pendulum = Model::from_mjcf(PENDULUM).unwrap_or_else(|error| panic!("{error}"));
    let definition = OwnCause {
        name: "mine".into(),
        sentence: None,
        place: Place::Joint("hinge".into()),
        terms: vec![(Acts::Torque, crate::text(bytes).into_owned())],
        parameters: vec![OwnParameter::size("size", "N m", [0.0, 1e-2], 1e-5)],
    };
    let known = pendulum.own_causes().len();
    let taken = pendulum.define_cause(&definition).is_ok();
    assert_eq!(pendulum.own_causes().len(), known + usize::from(taken));
    taken
}

/// An experiment beside runs that it may name: one that is taken has a run.
pub(crate) fn experiment(bytes: &[u8]) -> bool {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/hidden/mujoco/buoyancy/experiment.toml");
    let Ok(experiment) = Experiment::parse(&crate::text(bytes), &path) else { return false };
    assert!(!experiment.runs.is_empty(), "taken without a run");
    true
}
