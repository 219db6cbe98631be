//! Tables of keypoints and angles, our own and other programs'.

use std::path::Path;

use camera::calibration::Plane;
use ident::table;
use interchange::marks::{self, Times};
use interchange::{Imported, Marks};

/// Our trajectories: a table that is written again says the same.
pub(crate) fn trajectory(bytes: &[u8]) -> bool {
    let name = Path::new("trajectory.csv");
    let Ok(read) = table::parse_trajectory(&crate::text(bytes), name) else { return false };
    assert_eq!(read.position_m.len(), read.keypoints.len() * read.time_s.len());
    let written = table::trajectory_text(&read);
    let again = table::parse_trajectory(&written, name).unwrap_or_else(|error| panic!("{error}:\n{written}"));
    assert_eq!(table::trajectory_text(&again), written);
    true
}

/// Our angles of servos: a table that is written again says the same.
pub(crate) fn servo(bytes: &[u8]) -> bool {
    let name = Path::new("servo.csv");
    let Ok(read) = table::parse_servo(&crate::text(bytes), name) else { return false };
    let written = table::servo_text(&read.command, &read.measured);
    let again = table::parse_servo(&written, name).unwrap_or_else(|error| panic!("{error}:\n{written}"));
    assert_eq!(table::servo_text(&again.command, &again.measured), written);
    true
}

fn in_the_plane(marks: &Marks) {
    let plane = Plane::square(0.001, [0.0, 0.0]);
    if let (Ok(chosen), Ok(times_s)) = (marks::chosen(&marks.parts, None), marks.times_s(&Times::Rate(10.0)))
    {
        let imported = marks.imported(&chosen, &times_s, &plane, 0.6, Some(1.0));
        assert_eq!(imported.trajectory.position_m.len(), chosen.len() * times_s.len());
        a_row_an_image(&imported);
        // what we say in the other program's words comes back
        if let Ok(text) = interchange::dlc::text(&imported.trajectory, &plane) {
            let again = interchange::dlc::read(&text, None);
            assert_eq!(
                again.map_err(|error| error.to_string()).map(|marks| marks.parts.len()),
                Ok(chosen.len())
            );
        }
    }
}

fn a_row_an_image(imported: &Imported) {
    let trajectory = &imported.trajectory;
    assert_eq!(imported.images.len(), trajectory.time_s.len());
    assert_eq!(trajectory.position_m.len(), trajectory.keypoints.len() * trajectory.time_s.len());
}

/// DeepLabCut's tables.
pub(crate) fn dlc(bytes: &[u8]) -> bool {
    let text = crate::text(bytes);
    let read = [None, Some("i")].map(|individual| interchange::dlc::read(&text, individual));
    read.iter().flatten().inspect(|marks| in_the_plane(marks)).count() > 0
}

/// SLEAP's tables.
pub(crate) fn sleap(bytes: &[u8]) -> bool {
    interchange::sleap::read(&crate::text(bytes), None).iter().inspect(|marks| in_the_plane(marks)).count()
        > 0
}

/// Lines of worms and other animals.
pub(crate) fn wcon(bytes: &[u8]) -> bool {
    let Ok(document) = interchange::wcon::read(&crate::text(bytes)) else { return false };
    document.imported(None, &[0.0, 0.5, 1.0]).iter().for_each(a_row_an_image);
    document.one_each("a,b").iter().for_each(a_row_an_image);
    true
}
