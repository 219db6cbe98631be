//! Where everything is in the world.

use super::kinematics::kinematics;
use super::plant::Plant;
use super::work::Work;
use crate::math::{Mat3, Quat, Vec3};
use crate::model::Model;
use crate::scalar::Scalar;
use crate::space::Spatial;

/// World poses of everything at one set of coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Poses<T = f64> {
    /// Origins of the bodies \[m\], shape (bodies).
    pub body_pos: Vec<Vec3<T>>,
    /// `world_from_body`, shape (bodies).
    pub body_rot: Vec<Mat3<T>>,
    /// Centres of the geoms \[m\], shape (geoms).
    pub geom_pos: Vec<Vec3<T>>,
    /// `world_from_geom`, shape (geoms).
    pub geom_rot: Vec<Mat3<T>>,
    /// Positions of the sites \[m\], shape (sites).
    pub site_pos: Vec<Vec3<T>>,
}

impl<T: Scalar> Model<T> {
    /// World poses of bodies, geoms and sites at the coordinates `qpos`, shape (nq).
    ///
    /// # Panics
    /// When `qpos` has another length than [`Model::nq`].
    pub fn poses(&self, qpos: &[T]) -> Poses<T> {
        assert_eq!(qpos.len(), self.nq(), "qpos has as many entries as the model has coordinates");
        let plant = Plant::<Spatial<T>>::new(self, ());
        let mut work = Work::new(&plant);
        kinematics(&plant, qpos, &mut work);
        let place = |body: usize, at: Vec3<T>| work.pos[body] + work.rot[body].apply(at);
        let turn = |body: usize, quat: Quat<T>| work.rot[body].product(&quat.matrix());
        Poses {
            geom_pos: self.geoms.iter().map(|geom| place(geom.body, geom.pos)).collect(),
            geom_rot: self.geoms.iter().map(|geom| turn(geom.body, geom.quat)).collect(),
            site_pos: self.sites.iter().map(|site| place(site.body, site.pos)).collect(),
            body_pos: work.pos,
            body_rot: work.rot,
        }
    }
}
