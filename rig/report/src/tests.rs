//! The page as a whole, from made-up numbers.

use ident::experiment::Use;
use ident::fit::{Fit, FittedParameter, RunErrors};
use ident::loss::KeypointError;
use image::{GrayImage, Luma};
use sim::{Command, Trajectory};

use super::*;
use record::losses::Losses;
use record::timing::{Stage, Timing};

const HOSTILE: &str = "<script>alert('x')</script>\"&";
const LINK_M: f64 = 0.025;
const NOISE_M: f64 = 2e-4;

/// A swing that dies away, of three links; `lag_s` shifts it.
fn swing(lag_s: f64, noise_m: f64, seconds: f64) -> Trajectory {
    let mut trajectory =
        Trajectory { keypoints: ["P1", "P2", "P3"].map(String::from).to_vec(), ..Trajectory::default() };
    let mut jitter = 0.5_f64;
    for i in 0..(seconds * 100.0) as usize {
        let t = i as f64 / 100.0;
        trajectory.time_s.push(t);
        let since = (t - 0.2).max(0.0) - lag_s * f64::from(t > 0.2);
        let (mut x, mut z) = (0.0, 0.0);
        for link in 0..3 {
            let angle = 1.4 * (-0.7 * since).exp() * (6.0 * since - 0.4 * f64::from(link) * since).cos();
            x += LINK_M * angle.sin();
            z -= LINK_M * angle.cos();
            jitter = (jitter * 9301.0 + 0.49297).fract();
            let noise = (jitter - 0.5) * 3.46 * noise_m;
            let lost = noise_m > 0.0 && (150..160).contains(&i);
            trajectory.position_m.push(if lost { [f64::NAN; 3] } else { [x + noise, f64::NAN, z - noise] });
        }
    }
    trajectory
}

fn parameter(name: &str, value: f64, std: f64) -> FittedParameter {
    FittedParameter {
        name: name.into(),
        value,
        std,
        lower: 0.0,
        upper: 3.0,
        at_bound: value == 0.0,
        determined: std < 1.0,
        ..FittedParameter::default()
    }
}

fn errors(id: &str, usage: Use, errors_mm: [f64; 3]) -> RunErrors {
    let keypoint = |(k, mm): (usize, f64)| KeypointError {
        name: format!("P{}", k + 1),
        mean_error_m: mm * 1e-3,
        rms_error_m: mm * 1.2e-3,
    };
    let keypoints = errors_mm.into_iter().enumerate().map(keypoint).collect();
    RunErrors {
        id: id.into(),
        usage,
        keypoints,
        lost: Vec::new(),
        set_aside: Vec::new(),
        noise: None,
        touch: None,
    }
}

fn overlay(time_s: f64) -> Overlay {
    let mut image = GrayImage::from_fn(640, 480, |x, y| Luma([(190 + (x / 16 + y / 16) % 2 * 4) as u8]));
    let mut mask = GrayImage::new(640, 480);
    let mut centreline_px = Vec::new();
    let mut keypoints_px = vec![("P0".to_owned(), [320.0, 60.0])];
    let mut base = [320.0, 60.0];
    for link in 0..3 {
        let angle = 0.9 - 0.5 * f64::from(link) + time_s;
        for step in 0..=100 {
            let along = f64::from(step);
            let (x, y) = (base[0] + along * angle.sin(), base[1] + along * angle.cos());
            for (dx, dy) in (-16i32..16).flat_map(|dx| (-16i32..16).map(move |dy| (dx, dy))) {
                if dx * dx + dy * dy < 250 {
                    let (column, row) = ((x as i32 + dx) as u32, (y as i32 + dy) as u32);
                    if column < 640 && row < 480 {
                        image.put_pixel(column, row, Luma([70]));
                        mask.put_pixel(column, row, Luma([255]));
                    }
                }
            }
            centreline_px.push([x, y]);
        }
        base = [base[0] + 100.0 * angle.sin(), base[1] + 100.0 * angle.cos()];
        keypoints_px.push((format!("P{}", link + 1), base));
    }
    let name = format!("{:.0}", time_s * 100.0);
    Overlay { name, time_s, image, mask: Some(mask), centreline_px, keypoints_px, status: "accepted".into() }
}

fn strip_image(time_s: f64) -> StripImage {
    let cut = |image: &GrayImage| image::imageops::crop_imm(image, 200, 40, 280, 300).to_image();
    StripImage {
        time_s,
        filmed: cut(&overlay(time_s).image),
        simulated: cut(&overlay(time_s + 0.02).image),
        errors_m: [("P1", 1e-4), ("P3", 3.2e-4)].map(|(name, error)| (name.into(), error)).to_vec(),
    }
}

/// Dark images in which nothing was found, and doubtful ones.
fn refused() -> Vec<RefusedImages> {
    let dark = |k: u32| Overlay {
        image: GrayImage::from_pixel(640, 480, Luma([20 + k as u8])),
        mask: None,
        centreline_px: Vec::new(),
        keypoints_px: Vec::new(),
        status: format!("dark: its middle grey level is {}, usually 190", 20 + k),
        ..overlay(0.01 * f64::from(k))
    };
    let doubt = "P2 is known to 1.4 px (1 sigma) only: too little of the mechanism is seen there";
    let doubtful = |time_s: f64| Overlay { status: doubt.into(), ..overlay(time_s) };
    vec![
        RefusedImages {
            reason: "dark: its middle grey level is 20 to 23, usually 190".into(),
            doubtful: false,
            count: 7,
            shown: [0, 1, 2, 3].map(dark).to_vec(),
            unreadable: 0,
        },
        RefusedImages {
            reason: "unreadable: marked as damaged by the camera".into(),
            doubtful: false,
            count: 1,
            shown: Vec::new(),
            unreadable: 1,
        },
        RefusedImages {
            reason: doubt.into(),
            doubtful: true,
            count: 2,
            shown: [0.5, 0.9].map(doubtful).to_vec(),
            unreadable: 0,
        },
    ]
}

fn whole() -> ReportData {
    let names = ["blunt", "slender", "angular", "kutta", "magnus"];
    let mut parameters: Vec<_> = (0..15)
        .map(|i| {
            let name = format!("g{}/{}", i / 5 + 1, names[i % 5]);
            let loose = [3, 4, 6].contains(&i);
            parameter(&name, 0.3 + 0.13 * i as f64, if loose { 2.5 } else { 0.02 * (i + 1) as f64 })
        })
        .collect();
    parameters.push(FittedParameter { upper: 1e-4, ..parameter("q2/damping", 2.1e-6, 4e-7) });
    parameters.push(FittedParameter { upper: 1e-4, ..parameter("q3/frictionloss", 0.0, 3e-8) });
    let run = |id: &str, usage, lag_s| RunFigures {
        id: id.into(),
        usage,
        measured: swing(0.0, NOISE_M, 4.0),
        simulated: swing(lag_s, 0.0, 4.0),
        base_m: Some([0.0; 3]),
        start_s: Some(0.2),
        measured_pose: Some(overlay(0.0)),
        simulated_pose: Some(overlay(0.0).image),
        strip: [0.0, 0.4, 0.8].map(strip_image).to_vec(),
        ..RunFigures::default()
    };
    ReportData {
        id: "20261120T101503Z-ab12cd".into(),
        date: "2026-11-20 10:15:03 UTC".into(),
        description: "Drop of the three-link chain from the horizontal pose, hanging mount.".into(),
        end: Some(RunEnd::Success),
        diagnosis: None,
        fit: Some(Fit {
            method: "hybrid".into(),
            seed: 1,
            evaluations: 412,
            rollouts: 824,
            stop_reason: "converged".into(),
            loss_m2: 4.1e-7,
            noise_m: NOISE_M,
            error_m: Some(2e-4),
            holdout_error_m: Some(3e-4),
            parameters,
            runs: vec![
                errors("drop-horizontal", Use::Fit, [0.25, 0.26, 0.29]),
                errors("drop-right-angle", Use::Holdout, [0.31, 0.44, 0.52]),
            ],
            characteristic_length_m: 0.08,
            unidentifiable: vec![["g1/blunt", "g1/slender", "g1/angular"].map(String::from).to_vec()],
            ..Fit::default()
        }),
        runs: vec![run("drop-horizontal", Use::Fit, 0.002), run("drop-right-angle", Use::Holdout, 0.006)],
        motions: ["drop-horizontal", "drop-right-angle"].map(super::motion::tests::sample).to_vec(),
        overlays: [0.0, 0.4, 0.8].map(overlay).to_vec(),
        refused: refused(),
        servo: Some(ServoTrace {
            commanded: Command {
                actuators: vec!["servo".into()],
                time_s: vec![0.0, 0.5, 1.5, 2.0, 3.0, 3.5],
                angle_rad: vec![0.0, 0.0, 0.6, -0.6, 0.6, -0.6],
            },
            measured: None,
        }),
        images: Some(ImageQuality {
            received: 400,
            used: 390,
            rejected: vec![("mechanism leaves the picture".into(), 10)],
            lost: 1,
            dropped: 0,
            unread: 0,
            fps: Some(100.02),
            longest_gap_s: Some(0.02),
            losses: Losses { received: 400, lost: 1, ..Losses::default() },
        }),
        clocks: vec![ClockQuality {
            name: "servo board".into(),
            sigma_s: 4.2e-5,
            samples: 31,
            drift_ppm: Some(-12.3),
        }],
        timing: Timing {
            workers: 2,
            stages: [("film", 4.3), ("extract", 2.1), ("fit", 8.8)]
                .map(|(name, wall_s)| Stage { name: name.into(), wall_s })
                .to_vec(),
        },
        warnings: vec!["One image was lost before it reached the host.".into()],
        provenance: vec![("rig".into(), "0.1.0".into()), ("model".into(), "chain-passive.xml".into())],
        config_toml: Some("[camera]\nfps = 100.0\n".into()),
    }
}

/// `RIG_REPORT_SAMPLE=page.html cargo test -p rig report` writes the page, to be looked at in a browser.
#[test]
fn whole_report_shows_every_part_and_asks_nothing_of_the_net() {
    let page = render(&whole());
    if let Ok(path) = std::env::var("RIG_REPORT_SAMPLE") {
        std::fs::write(path, &page).unwrap();
    }
    for part in
        ["errors", "motion", "images", "refused", "coefficients", "servo", "quality", "timings", "provenance"]
    {
        assert!(page.contains(&format!("<section id=\"{part}\"")), "no section {part}");
    }
    let strip = page.split("class=\"filmstrip\"").nth(1).expect("a film strip");
    assert_eq!(strip.split("</table>").next().unwrap().matches("<img").count(), 6);
    assert!(
        strip.contains("<th>P2 error [mm]</th><td class=\"number\">–</td>"),
        "a keypoint that was not seen"
    );
    assert!(page.contains(
        "to their noise: off by 0.20 mm where it was fitted and 0.30 mm on held-out runs, 1.5 times"
    ));
    assert!(page.contains("6 of 17 coefficients are not determined by these runs"));
    let elsewhere = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    assert!(!elsewhere.contains("http:") && !elsewhere.contains("https:"), "the page must be self-contained");
}

#[test]
fn report_of_nothing_but_a_name_is_a_page_without_sections() {
    let page = render(&ReportData { id: "empty".into(), ..ReportData::default() });
    assert!(page.contains("<h1>empty</h1>") && page.contains("Nothing was measured."));
    assert!(!page.contains("<section"));
}

#[test]
fn names_from_elsewhere_cannot_bring_a_script_along() {
    let mut data = whole();
    data.id = HOSTILE.into();
    data.end = Some(RunEnd::Fail(HOSTILE.into()));
    data.description = HOSTILE.into();
    data.config_toml = Some(HOSTILE.into());
    data.warnings = vec![HOSTILE.into()];
    data.provenance = vec![(HOSTILE.into(), HOSTILE.into())];
    data.motions = vec![super::motion::tests::sample(HOSTILE); 2];
    for run in &mut data.runs {
        run.id = HOSTILE.into();
        run.strip[0].errors_m[0].0 = HOSTILE.into();
        run.measured.keypoints[0] = HOSTILE.into();
        run.simulated.keypoints[0] = HOSTILE.into();
    }
    for overlay in &mut data.overlays {
        overlay.status = HOSTILE.into();
        overlay.keypoints_px[0].0 = HOSTILE.into();
    }
    for group in &mut data.refused {
        group.reason = HOSTILE.into();
        for shown in &mut group.shown {
            (shown.name, shown.status) = (HOSTILE.into(), HOSTILE.into());
        }
    }
    if let Some(servo) = &mut data.servo {
        servo.commanded.actuators[0] = HOSTILE.into();
    }
    if let Some(fit) = &mut data.fit {
        fit.parameters[0].name = HOSTILE.into();
        fit.runs[0].id = HOSTILE.into();
        fit.runs[0].keypoints[0].name = HOSTILE.into();
        fit.unidentifiable[0][0] = HOSTILE.into();
        fit.stop_reason = HOSTILE.into();
    }
    let page = render(&data);
    assert!(page.contains("&lt;script&gt;"));
    let own = format!("<script>{}</script>", super::motion::SCRIPT);
    assert!(!super::motion::SCRIPT.contains("</"), "it would end early");
    let elsewhere = page.replacen(&own, "", 1);
    assert!(!elsewhere.contains("<script") && !elsewhere.contains("</script"), "a script got through");
}

#[test]
fn failed_run_says_so_first() {
    let mut data = whole();
    data.end = Some(RunEnd::Fail("camera unplugged at 3.00 s".into()));
    let page = render(&data);
    assert!(page.contains("<div class=\"verdict bad\"><p class=\"line\">Failed: camera unplugged at 3.00 s"));
}

/// Findings of a fit that is as good as it can be.
fn good() -> Findings {
    Findings {
        error_m: Some(5e-6),
        noise_m: 5e-6,
        coefficients: 12,
        determined: 12,
        runs: 1,
        images: Some(Losses { received: 600, ..Losses::default() }),
        ..Findings::default()
    }
}

#[test]
fn headline_is_green_only_where_error_images_coefficients_and_diagnosis_all_allow_it() {
    use ident::diagnose::Verdict;
    let said = |findings: Findings| {
        let Headline { tone, line } = findings.headline();
        println!("{tone:?}: {line}");
        (tone, line)
    };
    let (tone, line) = said(good());
    assert_eq!(tone, Tone::Good);
    assert!(line.starts_with("The simulation follows the keypoints to their noise"), "{line}");
    assert!(
        line.contains("1.0 times the noise") && line.contains("all 12 coefficients are determined"),
        "{line}"
    );

    // as the run of the issue: far beyond the noise, 8 of 12 coefficients open
    let (tone, line) = said(Findings { error_m: Some(2.8e-4), determined: 4, ..good() });
    assert_eq!(tone, Tone::Bad);
    assert!(line.contains("off by 0.28 mm, 56 times the noise of 0.0050 mm"), "{line}");
    assert!(line.contains("8 of 12 coefficients are not determined by this run"), "{line}");
    assert!(!line.contains("follows"), "{line}");

    let lost = |received, lost| Losses { received, lost, ..Losses::default() };
    // each by itself is enough
    for (worse, tone, word) in [
        (Findings { error_m: Some(2.1 * 5e-6), ..good() }, Tone::Caution, "2.1 times the noise"),
        (Findings { holdout_error_m: Some(3.0 * 5e-6), ..good() }, Tone::Caution, "3.0 times the noise"),
        (Findings { error_m: None, ..good() }, Tone::Bad, "no error"),
        (Findings { noise_m: 0.0, ..good() }, Tone::Caution, "not known"),
        (Findings { determined: 11, ..good() }, Tone::Caution, "1 of 12 coefficients is not determined"),
        (Findings { determined: 0, ..good() }, Tone::Bad, "none of 12 coefficients is determined"),
        (good().filmed(lost(593, 7)), Tone::Caution, "7 of 600 images are missing"),
        (good().filmed(lost(382, 225)), Tone::Bad, "225 of 607 images are missing"),
        (good().filmed(Losses { unread: 1, ..lost(600, 0) }), Tone::Caution, "1 lost from the recording"),
        (good().diagnosed(Verdict::Suspected, 5e-6), Tone::Caution, "no other run has checked"),
        (good().diagnosed(Verdict::Ambiguous, 5e-6), Tone::Caution, "several causes"),
        (good().diagnosed(Verdict::Unexplained, 5e-6), Tone::Bad, "no known cause explains"),
    ] {
        let (said, line) = said(worse);
        assert_eq!(said, tone, "{line}");
        assert!(line.contains(word), "{line}");
    }
    assert_eq!(said(good().filmed(lost(599, 1))).0, Tone::Good, "one image in 600 is no loss worth a word");
    assert_eq!(said(good().diagnosed(Verdict::NothingDetectable, 5e-6)).0, Tone::Good);
}

#[test]
fn colour_of_the_page_is_that_of_its_headline() {
    let mut data = whole();
    let caution = render(&data);
    assert!(
        caution.contains(
            "<div class=\"verdict caution\"><p class=\"line\">The simulation follows the keypoints"
        )
    );
    if let Some(fit) = &mut data.fit {
        fit.error_m = Some(55.0 * NOISE_M);
    }
    let page = render(&data);
    assert!(page.contains("<div class=\"verdict bad\"><p class=\"line\">The simulation is off by 11.00 mm"));
    assert!(page.contains("55 times the noise of 0.20 mm"));
}

#[test]
fn one_error_and_one_noise_stand_on_a_page() {
    let page = render(&whole());
    let tile = |name: &str| {
        page.split(&format!("<dt>{name}</dt><dd>")).nth(1).and_then(|rest| rest.split('<').next())
    };
    assert_eq!(
        [tile("error"), tile("error, held out"), tile("noise")],
        [Some("0.20 mm"), Some("0.30 mm"), Some("0.20 mm")]
    );
    assert_eq!(tile("error over noise"), Some("1.5"));
    let text = summary(&whole());
    assert!(text.contains(
        "off by 0.20 mm where it was fitted and 0.30 mm on held-out runs, 1.5 times the noise of 0.20 mm"
    ));
    assert!(text.contains("Error: root mean square along one axis, over all keypoints but P0"), "{text}");
}

#[test]
fn report_is_the_same_every_time() {
    assert_eq!(render(&whole()), render(&whole()));
}
