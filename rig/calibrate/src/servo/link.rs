//! The driven link's angle, from keypoints.

use sim::{Command, Model, RolloutOptions, Trajectory};

use super::error::ServoCalibrateError;

/// Where the driven link is in a model: the names of its ends, and its angle at the command 0 \[rad\].
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenLink {
    /// The keypoint at the pivot, where the model has one, and the pivot's place \[m\].
    base: (Option<String>, [f64; 3]),
    tip: String,
    /// Which coordinates are to the right and up in the picture.
    axes: [usize; 2],
    zero_rad: f64,
}

/// Keypoints nearer than this to the pivot are at the pivot \[m\] (chosen).
const PIVOT_DISTANCE_MAX_M: f64 = 1e-6;

impl DrivenLink {
    /// The link that `actuator` turns in `model`, as seen along the axes to the right and up in the picture.
    ///
    /// # Errors
    /// [`ServoCalibrateError::Link`].
    pub fn of(model: &Model, actuator: &str, axes: [usize; 2]) -> Result<Self, ServoCalibrateError> {
        let lacking = |what: String| ServoCalibrateError::Link { actuator: actuator.into(), what };
        let drive = model.actuators.iter().find(|drive| drive.name == actuator);
        let joint = drive.map(|drive| &model.joints[drive.joint]);
        let joint = joint.ok_or_else(|| lacking("the model has no actuator of that name".into()))?;
        let rest =
            sim::rollout(model, &model.rest_state(), &Command::default(), &[0.0], &RolloutOptions::default())
                .map_err(|error| lacking(error.to_string()))?;
        let place =
            |name: &str| rest.keypoints.iter().position(|known| known == name).map(|k| rest.position_m[k]);
        let off = |pos: [f64; 3]| {
            let anchor = joint.pos.0;
            (0..3).map(|k| (pos[k] - anchor[k]).powi(2)).sum::<f64>().sqrt()
        };
        let sites = || {
            let on_link = model.sites.iter().filter(|site| site.body == joint.body);
            on_link.filter_map(|site| Some((site, off(site.pos.0), place(&site.name)?)))
        };
        let tip = sites().filter(|site| site.1 > PIVOT_DISTANCE_MAX_M).max_by(|a, b| a.1.total_cmp(&b.1));
        let (tip, _, tip_m) =
            tip.ok_or_else(|| lacking("its body has no keypoint beside its pivot".into()))?;
        let base = sites().find(|site| site.1 <= PIVOT_DISTANCE_MAX_M);
        let (name, base_m) = base
            .map(|(site, _, at)| (site.name.clone(), at))
            .ok_or_else(|| lacking("its pivot is no keypoint: add a site `P0` there".into()))?;
        let zero_rad = angle(base_m, tip_m, axes);
        Ok(Self { base: (Some(name), base_m), tip: tip.name.clone(), axes, zero_rad })
    }

    /// Times \[s\] of the images that show the link, and its angles there \[rad\], counter-clockwise as the camera sees it. The pivot does not
    /// move: its place is the median over all images.
    ///
    /// # Errors
    /// [`ServoCalibrateError::Link`] where the trajectory lacks its end.
    pub fn angles(&self, trajectory: &Trajectory) -> Result<(Vec<f64>, Vec<f64>), ServoCalibrateError> {
        let place = |name: &str| trajectory.keypoints.iter().position(|known| known == name);
        let tip = place(&self.tip).ok_or_else(|| ServoCalibrateError::Link {
            actuator: self.tip.clone(),
            what: format!("no image shows `{}`", self.tip),
        })?;
        let shown =
            |keypoint: usize| (0..trajectory.time_s.len()).map(move |i| (i, trajectory.at(i, keypoint)));
        let mut base_m = self.base.1;
        if let Some(base) = self.base.0.as_deref().and_then(place) {
            for axis in self.axes {
                let mut all: Vec<f64> =
                    shown(base).map(|(_, at)| at[axis]).filter(|x| x.is_finite()).collect();
                if let Some(middle) = ground::statistics::median(&mut all, f64::total_cmp) {
                    base_m[axis] = middle;
                }
            }
        }
        let angles = shown(tip).map(|(i, at)| (trajectory.time_s[i], angle(base_m, at, self.axes)));
        let turn = std::f64::consts::TAU;
        Ok(angles
            .filter(|(_, angle)| angle.is_finite())
            .map(|(t, angle)| (t, (angle - self.zero_rad + 0.5 * turn).rem_euclid(turn) - 0.5 * turn))
            .unzip())
    }
}

fn angle(base: [f64; 3], tip: [f64; 3], [right, up]: [usize; 2]) -> f64 {
    (tip[up] - base[up]).atan2(tip[right] - base[right])
}
