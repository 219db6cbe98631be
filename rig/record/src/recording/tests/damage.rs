//! What becomes of a recording whose file was damaged in any way.

use proptest::prelude::*;
use proptest::sample::Index;

use super::super::writer::Writer;
use super::super::*;
use crate::folder::RunFolder;
use crate::frames::FrameRow;
use crate::losses::Losses;
use crate::reader::{Item, Recording};
use crate::repair::repair;
use crate::start_stop::Stop;
use camera::fixtures;

const SIZE_PX: (u32, u32) = (8, 4);
const IMAGES: u32 = 7;

fn image(sequence: u32) -> CameraImage {
    fixtures::image(sequence, MonotonicNs(1_000_000 * u64::from(sequence + 1)), SIZE_PX)
}

/// A recording with a chunk for each image, behind that of the channels; closed or cut off.
fn recording(path: &Path, closed: bool) -> Vec<u8> {
    let file = File::create(path).unwrap();
    let mut writer = Writer::new(file, path, Some(&fixtures::info(SIZE_PX)), 0).unwrap();
    for sequence in 0..IMAGES {
        let message = Message::Image(Arc::new(image(sequence)));
        writer.write(&Queued { log_time: MonotonicNs(u64::from(sequence) + 1), message }).unwrap();
        writer.flush().unwrap();
    }
    if closed {
        writer.finish().unwrap();
    }
    std::fs::read(path).unwrap()
}

#[derive(Debug, Clone)]
enum Damage {
    Flip { at: Index, bit: u8 },
    Cut { at: Index },
    Delete { from: Index, bytes: usize },
    Garble { from: Index, bytes: usize, with: u8 },
    Insert { at: Index, bytes: usize, with: u8 },
}

impl Damage {
    fn any() -> impl Strategy<Value = Self> {
        let (place, bytes) = (any::<Index>, 1_usize..400);
        prop_oneof![
            6 => (place(), 0_u8..8).prop_map(|(at, bit)| Self::Flip { at, bit }),
            1 => place().prop_map(|at| Self::Cut { at }),
            2 => (place(), bytes.clone()).prop_map(|(from, bytes)| Self::Delete { from, bytes }),
            1 => (place(), bytes.clone(), any::<u8>()).prop_map(|(from, bytes, with)| Self::Garble { from, bytes, with }),
            1 => (place(), bytes, any::<u8>()).prop_map(|(at, bytes, with)| Self::Insert { at, bytes, with }),
        ]
    }

    fn does_to(&self, file: &mut Vec<u8>) {
        if file.is_empty() {
            return;
        }
        let length = file.len();
        match self {
            Self::Flip { at, bit } => file[at.index(length)] ^= 1_u8 << *bit,
            Self::Cut { at } => file.truncate(at.index(length)),
            Self::Delete { from, bytes } => {
                let from = from.index(length);
                file.drain(from..(from + bytes).min(length));
            }
            Self::Garble { from, bytes, with } => {
                let from = from.index(length);
                file[from..(from + bytes).min(length)].fill(*with);
            }
            Self::Insert { at, bytes, with } => {
                let at = at.index(length);
                file.splice(at..at, std::iter::repeat_n(*with, *bytes));
            }
        }
    }
}

/// The counts of the images that the recording at `path` gives, each as it was recorded, and its run's rows.
fn read(path: &Path) -> (Vec<u32>, Vec<FrameRow>) {
    let (mut images, mut rows) = (Vec::new(), Vec::new());
    // what cannot be read was no loss of the camera's
    let mut last = None;
    for item in Recording::open(path).into_iter().flatten() {
        match item.unwrap().1 {
            Item::Image(got) => {
                assert_eq!(
                    (got.mid_exposure, &got.data),
                    (image(got.sequence).mid_exposure, &image(got.sequence).data)
                );
                rows.push(FrameRow {
                    sequence: got.sequence,
                    time_s: got.mid_exposure.seconds_since(MonotonicNs(0)),
                    stamp_ns: got.stamp.0,
                    damaged: got.damaged,
                    lost_before: last.map_or(0, |last| camera::images_lost(last, got.sequence)),
                    status: "ok".into(),
                    reason: String::new(),
                });
                last = Some(got.sequence);
                images.push(got.sequence);
            }
            Item::Gap => last = None,
            other => panic!("{other:?}"),
        }
    }
    (images, rows)
}

/// The counts of those images of the recording `whole` whose chunks stand in `bytes` as they were written.
fn whole_in(bytes: &[u8], whole: &[u8]) -> Vec<u32> {
    let chunks = fixtures::chunks(whole);
    let records = (0..).zip(&chunks[1..]).map(|(sequence, messages)| {
        // the whole record, from its number on
        let record = &whole[messages.start - 53..messages.end];
        assert_eq!(record[0], mcap::records::op::CHUNK);
        (sequence, record)
    });
    let stands = |record: &[u8]| bytes.windows(record.len()).any(|window| window == record);
    records.filter(|(_, record)| stands(record)).map(|(sequence, _)| sequence).collect()
}

#[test]
fn three_bytes_missing_anywhere_cost_no_chunk_that_is_whole() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("recording.mcap");
    let whole = recording(&path, false);
    for from in 0..whole.len() - 3 {
        let mut bytes = whole.clone();
        bytes.drain(from..from + 3);
        std::fs::write(&path, &bytes).unwrap();
        let images = read(&path).0;
        let expected = whole_in(&bytes, &whole);
        assert!(expected.iter().all(|sequence| images.contains(sequence)), "from {from}: {images:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn recording_damaged_anywhere_gives_every_whole_image_and_the_rest_is_counted_as_lost(
        closed in any::<bool>(),
        damages in prop::collection::vec(Damage::any(), 1..4),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let stop = Stop { images: IMAGES.into(), ..crate::fixtures::stop() };
        let mut run = RunFolder::create(dir.path(), crate::fixtures::start("20261120T101503Z-ab12cd")).unwrap();
        let path = run.file("recording.mcap");
        let whole = recording(&path, closed);
        run.finish(stop, None).unwrap();
        let mut bytes = whole.clone();
        damages.iter().for_each(|damage| damage.does_to(&mut bytes));
        std::fs::write(&path, &bytes).unwrap();

        let (images, rows) = read(&path);
        prop_assert!(images.is_sorted_by(|a, b| a < b));
        for sequence in whole_in(&bytes, &whole) {
            prop_assert!(images.contains(&sequence), "image {} of {:?}", sequence, images);
        }
        let losses = Losses::by(&run, Some(&rows));
        prop_assert_eq!(losses.received, images.len() as u64 + losses.unread);
        prop_assert_eq!((losses.received, losses.lost), (u64::from(IMAGES), 0));

        // made whole, it gives the same to any reader
        let repaired = repair(&path, Some(&fixtures::info(SIZE_PX))).unwrap();
        prop_assert_eq!(&read(&path).0, &images);
        if !images.is_empty() && !repaired.was_whole {
            let bytes = std::fs::read(&path).unwrap();
            let strict: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().collect::<mcap::McapResult<_>>().unwrap();
            prop_assert_eq!(strict.len(), images.len());
            prop_assert!(repair(&path, None).unwrap().was_whole);
        }
    }
}
