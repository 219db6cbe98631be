//! What `examples/three_links.rs` makes of the paper's four cases before anything is filmed.

use std::path::Path;

use config::RigConfig;
use system_tests::three_links::{CASES, write_thirds_model};

/// Heights of the straight chain's points in the model at `path` \[m\], at rest.
fn heights_m(path: &Path) -> Vec<(String, f64)> {
    let text = std::fs::read_to_string(path).expect("the model");
    let model = sim::Model::from_mjcf(&text).expect("a model");
    // a straight chain's frames lie above each other
    let mut base_m = vec![0.0; model.bodies.len()];
    for body in 1..model.bodies.len() {
        base_m[body] = base_m[model.bodies[body].parent] + model.bodies[body].pos.0[2];
    }
    model.sites.iter().map(|site| (site.name.clone(), base_m[site.body] + site.pos.0[2])).collect()
}

#[test]
fn the_recipe_has_its_keypoints_where_thirds_of_a_skeleton_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let case = folder.path().join("driven-1");
    std::fs::create_dir(&case).expect("a folder");
    // a skeleton that ends 3 mm above the pivot and 5 mm below the tip
    let heights = [0.003, 0.0261, 0.0492, 0.0723];
    let mut table = "time_s,P0_x_m,P0_z_m,P1_x_m,P1_z_m,P2_x_m,P2_z_m,P3_x_m,P3_z_m\n".to_owned();
    for image in 0..30 {
        table += &format!("{}", f64::from(image) * 0.01);
        heights.iter().for_each(|z| table += &format!(",0,{z}"));
        table += "\n";
    }
    std::fs::write(case.join("trajectory.csv"), table).expect("a table");
    let path = folder.path().join("thirds.xml");
    write_thirds_model(folder.path(), &path).expect("a model");
    let found = heights_m(&path);
    assert_eq!(found.len(), 4);
    for (name, z) in ["P0", "P1", "P2", "P3"].iter().zip(heights) {
        let (_, height) = found.iter().find(|(found, _)| found == name).expect("each keypoint");
        assert!((height - z).abs() < 2e-6, "{name} at {height} m instead of {z}");
    }
}

#[test]
fn every_case_is_a_config_with_a_tank() {
    let folder = tempfile::tempdir().expect("a folder");
    for case in CASES {
        let path = case.write(folder.path(), |_| {}).expect("the case's files");
        let config = RigConfig::read(&path).expect("a config");
        assert!(config.run.prescribed, "{}", case.id);
        let tank = config.mock.expect("a mock").tank;
        assert!(folder.path().join(tank).is_file(), "{}", case.id);
    }
}
