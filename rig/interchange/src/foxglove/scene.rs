//! Links and keypoints as `foxglove.SceneUpdate`.

use serde_json::{Value, json};
use sim::Model;
use sim::model::{Geom, GeomKind};

use super::{Colour, MEASURED, SIMULATED, TANK, colour, frame_of, quaternion, time, xyz};

/// The links, each in its body's frame, to be sent once: [`super::transforms`] move them.
pub fn links(at_ns: u64, model: &Model) -> Value {
    let entity = |(body, name): (usize, &str)| {
        let mut parts = Parts::default();
        model.geoms.iter().filter(|geom| geom.body == body).for_each(|geom| parts.geom(geom));
        (!parts.is_empty())
            .then(|| parts.entity(at_ns, &frame_of(body, name), &format!("simulated/{name}"), true))
    };
    let bodies = model.bodies.iter().map(|body| body.name.as_str()).enumerate();
    update(bodies.filter_map(entity).collect())
}

/// Keypoints at `places_m` as balls of `radius_m`.
pub fn keypoints(at_ns: u64, places_m: &[[f64; 3]], radius_m: f64) -> Value {
    let mut parts = Parts::default();
    for &place in places_m {
        parts.ball(place, [radius_m; 3], &IDENTITY, MEASURED);
    }
    update(vec![parts.entity(at_ns, TANK, "measured", false)])
}

fn update(entities: Vec<Value>) -> Value {
    json!({ "deletions": [], "entities": entities })
}

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// What an entity is made of.
#[derive(Debug, Default)]
struct Parts {
    cubes: Vec<Value>,
    spheres: Vec<Value>,
    cylinders: Vec<Value>,
}

impl Parts {
    fn is_empty(&self) -> bool {
        self.cubes.is_empty() && self.spheres.is_empty() && self.cylinders.is_empty()
    }

    fn ball(&mut self, place: [f64; 3], semi_axes: [f64; 3], rotation: &[[f64; 3]; 3], paint: Colour) {
        self.spheres.push(primitive(place, rotation, semi_axes, paint));
    }

    fn geom(&mut self, geom: &Geom<f64>) {
        let (place, rotation) = (geom.pos.0, geom.quat.matrix().0);
        let [a, b, c] = geom.size;
        let mut cylinder = || {
            let mut one = primitive(place, &rotation, [a, a, b], SIMULATED);
            (one["bottom_scale"], one["top_scale"]) = (json!(1.0), json!(1.0));
            self.cylinders.push(one);
        };
        match geom.kind {
            GeomKind::Plane => {}
            GeomKind::Sphere => self.ball(place, [a; 3], &rotation, SIMULATED),
            GeomKind::Ellipsoid => self.ball(place, [a, b, c], &rotation, SIMULATED),
            GeomKind::Box => self.cubes.push(primitive(place, &rotation, [a, b, c], SIMULATED)),
            GeomKind::Cylinder => cylinder(),
            GeomKind::Capsule => {
                cylinder();
                for side in [b, -b] {
                    let end = std::array::from_fn(|i| place[i] + rotation[i][2] * side);
                    self.ball(end, [a; 3], &rotation, SIMULATED);
                }
            }
        }
    }

    fn entity(self, at_ns: u64, frame: &str, id: &str, locked: bool) -> Value {
        json!({
            "timestamp": time(at_ns), "frame_id": frame, "id": id, "frame_locked": locked,
            "lifetime": { "sec": 0, "nsec": 0 }, "metadata": [],
            "cubes": self.cubes, "spheres": self.spheres, "cylinders": self.cylinders,
            "arrows": [], "lines": [], "triangles": [], "texts": [], "models": [],
        })
    }
}

/// A shape with these half sizes.
fn primitive(place: [f64; 3], rotation: &[[f64; 3]; 3], half: [f64; 3], paint: Colour) -> Value {
    json!({
        "pose": { "position": xyz(place), "orientation": quaternion(rotation) },
        "size": xyz(half.map(|half| 2.0 * half)), "color": colour(paint),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shape_has_its_size_and_a_capsule_ends_in_balls() {
        let model = Model::from_mjcf(
            r#"<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="b"><joint/>
            <geom type="capsule" size="0.01 0.02" pos="0 0 -0.1" mass="1"/><geom type="box" size="0.01 0.02 0.03" mass="1"/>
            <geom type="ellipsoid" size="0.01 0.02 0.03" mass="1"/></body></worldbody></mujoco>"#,
        )
        .unwrap();
        let update = links(5, &model);
        let entities = update["entities"].as_array().unwrap();
        assert_eq!(entities.len(), 1, "a floor is not drawn");
        let body = &entities[0];
        assert_eq!(body["frame_id"], "simulated/b");
        assert_eq!(body["cylinders"][0]["size"], json!({ "x": 0.02, "y": 0.02, "z": 0.04 }));
        let ends: Vec<f64> =
            (0..2).map(|i| body["spheres"][i]["pose"]["position"]["z"].as_f64().unwrap()).collect();
        assert!((ends[0] + 0.08).abs() < 1e-12 && (ends[1] + 0.12).abs() < 1e-12, "{ends:?}");
        assert_eq!(body["spheres"][2]["size"], json!({ "x": 0.02, "y": 0.04, "z": 0.06 }));
        assert_eq!(body["cubes"][0]["size"], json!({ "x": 0.02, "y": 0.04, "z": 0.06 }));
    }
}
