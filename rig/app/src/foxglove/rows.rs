//! What is said once, and with each image.

use serde_json::{Map, Value, json};
use sim::model::encoded_joint;

use super::bag::{
    ANNOTATIONS, Bag, CALIBRATION, CAMERA_FRAME, FRAMES, IMAGE, JOURNAL, KEYPOINTS, MEASURED, SERVO,
    SIMULATED, TELEMETRY,
};
use super::holdings::{RunData, Simulation};
use camera::calibration::Px;
use interchange::foxglove::pinhole::Pinhole;
use interchange::foxglove::schemas::{self, Schema};
use interchange::foxglove::{self, Annotated, scene};
use record::simulated::row_at;

/// A keypoint is drawn as a ball of this share of the mechanism's length.
const BALL_SHARE: f64 = 0.03;

impl RunData {
    pub(super) fn open(&self, bag: &mut Bag) -> anyhow::Result<()> {
        bag.open(JOURNAL, &schemas::log())?;
        if self.has_recording {
            bag.open(IMAGE, &schemas::compressed_image())?;
            bag.open(
                TELEMETRY,
                &schemas::plotted("rig.ServoTelemetry", ["channel", "pulse_us", "count"].map(String::from)),
            )?;
            if self.plane.is_some() {
                bag.open(CALIBRATION, &schemas::camera_calibration())?;
                bag.open(CAMERA_FRAME, &schemas::frame_transforms())?;
            }
        }
        if !self.records.is_empty() {
            bag.open(ANNOTATIONS, &schemas::image_annotations())?;
        }
        if self.measured.is_some() {
            bag.open(MEASURED, &schemas::scene_update())?;
            let schema = json!({ "title": "rig.Keypoints", "type": "object",
                "additionalProperties": { "type": "object", "additionalProperties": { "type": "number" } } });
            bag.open(KEYPOINTS, &Schema { name: "rig.Keypoints", text: schema })?;
        }
        if self.simulation.is_some() {
            bag.open(SIMULATED, &schemas::scene_update())?;
            bag.open(FRAMES, &schemas::frame_transforms())?;
        }
        if let Some(command) = &self.command {
            let columns = command.actuators.iter();
            let columns = columns.flat_map(|name| [format!("{name}_rad"), format!("{name}_measured_rad")]);
            let columns = std::iter::once("time_s".to_owned()).chain(columns);
            bag.open(SERVO, &schemas::plotted("rig.Servo", columns))?;
        }
        Ok(())
    }

    /// What does not move.
    pub(super) fn still(&self, at_ns: u64, size_px: Option<[u32; 2]>, bag: &mut Bag) -> anyhow::Result<()> {
        let camera = self.plane.as_ref().zip(size_px).and_then(|(plane, size)| Pinhole::of(plane, size));
        if let Some(camera) = camera {
            bag.write(CALIBRATION, at_ns, &camera.calibration(at_ns))?;
            bag.write(CAMERA_FRAME, at_ns, &json!({ "transforms": [camera.transform(at_ns)] }))?;
        }
        if let Some(Simulation { model, .. }) = &self.simulation {
            bag.write(SIMULATED, at_ns, &scene::links(at_ns, model))?;
        }
        Ok(())
    }

    /// What belongs to the usable image number `row`.
    pub(super) fn row(&self, row: usize, at_ns: u64, bag: &mut Bag) -> anyhow::Result<()> {
        // the clock's own rounding, as the tables have it
        let time_s = self
            .records
            .get(row)
            .map(|record| record.time_s)
            .or_else(|| Some(*self.measured.as_ref()?.time_s.get(row)?));
        let Some(time_s) = time_s else { return Ok(()) };
        let poses = self
            .simulation
            .as_ref()
            .and_then(|Simulation { model, motion }| Some((model, model.poses(motion.at(time_s)?))));
        let simulated: Vec<(&str, [f64; 3])> = poses
            .iter()
            .flat_map(|(model, poses)| {
                model
                    .keypoint_sites()
                    .into_iter()
                    .map(|site| (model.sites[site].name.as_str(), poses.site_pos[site].0))
                    .collect::<Vec<_>>()
            })
            .collect();
        if let Some((model, poses)) = &poses {
            let names: Vec<&str> = model.bodies.iter().map(|body| body.name.as_str()).collect();
            bag.write(FRAMES, at_ns, &foxglove::transforms(at_ns, &names, poses))?;
        }
        if let Some(record) = self.records.get(row) {
            let visible: Vec<(&str, Px)> = self
                .names
                .iter()
                .zip(&record.keypoints)
                .filter_map(|(name, keypoint)| Some((name.as_str(), keypoint.as_ref()?.px)))
                .collect();
            let expected: Vec<Px> = self
                .plane
                .iter()
                .flat_map(|plane| simulated.iter().map(move |(_, place)| plane.pixel(self.view.seen(*place))))
                .collect();
            let drawn = Annotated {
                keypoints: &visible,
                centreline: &record.centreline,
                simulated: &expected,
                reason: &record.reason,
            };
            bag.write(ANNOTATIONS, at_ns, &foxglove::annotations(at_ns, &drawn))?;
        }
        self.keypoints(time_s, at_ns, &simulated, bag)
    }

    fn keypoints(
        &self,
        time_s: f64,
        at_ns: u64,
        simulated: &[(&str, [f64; 3])],
        bag: &mut Bag,
    ) -> anyhow::Result<()> {
        let Some(measured) = &self.measured else { return Ok(()) };
        let Some(instant) = row_at(&measured.time_s, time_s) else { return Ok(()) };
        let axes = self.view.seen_axes();
        let mut balls = Vec::new();
        let mut plotted = Map::new();
        for (k, name) in
            measured.keypoints.iter().enumerate().filter(|(_, name)| encoded_joint(name).is_none())
        {
            let place = measured.at(instant, k);
            let mut values = Map::new();
            let is_observed = axes.iter().all(|&(axis, _)| place[axis].is_finite());
            let expected = simulated.iter().find(|(other, _)| other == name).map(|(_, place)| *place);
            if is_observed {
                // a picture has no depth: take that of the simulation, or the plane of motion
                let deep = expected.unwrap_or_default();
                let known =
                    |axis: usize| Some(place[axis]).filter(|metres| metres.is_finite()).unwrap_or(deep[axis]);
                balls.push(std::array::from_fn(known));
            }
            for (axis, letter) in axes {
                if is_observed {
                    values.insert(format!("{letter}_mm"), json!(place[axis] * 1e3));
                }
                if let Some(expected) = expected {
                    values.insert(format!("simulated_{letter}_mm"), json!(expected[axis] * 1e3));
                }
            }
            if let (true, Some(expected)) = (is_observed, expected) {
                let error_m =
                    axes.iter().map(|&(axis, _)| place[axis] - expected[axis]).fold(0.0, f64::hypot);
                values.insert("error_mm".into(), json!(error_m * 1e3));
            }
            plotted.insert(name.clone(), Value::Object(values));
        }
        bag.write(MEASURED, at_ns, &scene::keypoints(at_ns, &balls, self.ball_m()))?;
        bag.write(KEYPOINTS, at_ns, &Value::Object(plotted))
    }

    /// Radius of the balls that stand for keypoints \[m\].
    fn ball_m(&self) -> f64 {
        const DEFAULT_LENGTH_M: f64 = 0.1;
        let length_m = self
            .simulation
            .as_ref()
            .map_or(DEFAULT_LENGTH_M, |known| ident::characteristic_length_m(&known.model));
        BALL_SHARE * length_m
    }
}
