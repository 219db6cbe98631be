//! Refused and doubtful images by their reasons, and which of them to look at.

use super::record::{ImageRecord, Status};
use ground::reasons::told_together;

/// Images that have a reason in common.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused {
    /// What they say; numbers that differ as ranges.
    pub reason: String,
    /// Rejected, or doubtful.
    pub status: Status,
    /// How many they are.
    pub count: usize,
    /// Places of those to look at among all records, spread evenly, rising.
    pub shown: Vec<usize>,
}

/// Shown of each reason, where there is room.
const OF_ONE_REASON: usize = 4;

/// The images of `records` that are not ok by their reasons, rejected ones first, then the most frequent ones; at most `most` are
/// shown, of each reason one before a second of any.
pub fn refused(records: &[ImageRecord], most: usize) -> Vec<Refused> {
    let mut groups = Vec::new();
    for status in [Status::Rejected, Status::Doubtful] {
        let places: Vec<usize> = (0..records.len()).filter(|&i| records[i].status == status).collect();
        for told in told_together(places.iter().map(|&i| records[i].reason.as_str())) {
            let members: Vec<usize> = told.members.iter().map(|&i| places[i]).collect();
            groups
                .push((Refused { reason: told.text, status, count: members.len(), shown: vec![] }, members));
        }
    }
    let mut shares = vec![0; groups.len()];
    let mut left = most;
    for _ in 0..OF_ONE_REASON {
        for (share, (_, members)) in shares.iter_mut().zip(&groups) {
            if left > 0 && *share < members.len() {
                (*share, left) = (*share + 1, left - 1);
            }
        }
    }
    let spread = |share: usize, members: &[usize]| -> Vec<usize> {
        (0..share).map(|k| members[k * (members.len() - 1) / (share - 1).max(1)]).collect()
    };
    groups
        .into_iter()
        .zip(shares)
        .map(|((group, members), share)| Refused { shown: spread(share, &members), ..group })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(status: Status, reason: &str) -> ImageRecord {
        ImageRecord {
            name: String::new(),
            time_s: 0.0,
            status,
            reason: reason.into(),
            keypoints: Vec::new(),
            mask: None,
            centreline: Vec::new(),
        }
    }

    #[test]
    fn each_reason_is_shown_before_any_is_shown_twice_and_images_are_spread() {
        let mut records = vec![record(Status::Ok, ""); 3];
        records.extend((0..9).map(|i| record(Status::Doubtful, &format!("P1 is known to {i} px"))));
        records.extend([record(Status::Rejected, "dark"), record(Status::Rejected, "torn: 7 rows")]);
        records.push(record(Status::Rejected, "torn: 9 rows"));
        let groups = refused(&records, 24);
        let told: Vec<(&str, usize, &[usize])> =
            groups.iter().map(|g| (g.reason.as_str(), g.count, g.shown.as_slice())).collect();
        assert_eq!(
            told,
            [
                ("torn: 7 to 9 rows", 2, &[13, 14][..]),
                ("dark", 1, &[12]),
                ("P1 is known to 0 to 8 px", 9, &[3, 5, 8, 11])
            ]
        );
        let few: Vec<usize> = refused(&records, 4).iter().map(|group| group.shown.len()).collect();
        assert_eq!(few, [2, 1, 1]);
        assert!(refused(&records, 0).iter().all(|group| group.shown.is_empty() && group.count > 0));
        assert_eq!(refused(&records[..3], 24), []);
    }
}
