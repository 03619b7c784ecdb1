//! The score of a drive: *streaming AP50*.
//!
//! At each of its ticks, control acts on boxes of an earlier frame, and the world has moved on
//! since. So the score compares the boxes behind a command with the places of people at its tick,
//! in the newest frame that was captured by then. Li, Wang and Ramanan score streaming perception
//! in this way (*Towards Streaming Perception*, ECCV 2020).
//!
//! - Within a tick, the boxes choose by falling score. Each takes the free person whom it overlaps
//!   most, if they overlap by half (`IoU` 0.5). A box that takes nobody is wrong; a person whom no
//!   box takes is missed.
//! - A tick that ends in a safe stop has no boxes, so everybody is missed.
//! - The boxes of all ticks are put in order by falling score. The precision at a recall is the
//!   greatest that is reached at this recall or a greater one. The score is the mean of the
//!   precision over the recalls 0, 0.01, … 1, in percent. This is COCO's AP at an `IoU` of 0.5 with
//!   people as the only class.
//!
//! A fresh detection scores better than a stale one of the same detector. If two detectors are
//! equally fresh, the one that finds more people scores better. The score counts no cost of a plan,
//! a stop or the bytes that were sent.

use std::time::Duration;

use super::recording::{Corners, Recording, Seen};

/// Records what control did at one tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Command {
    /// The instant of the tick, since the drive began.
    pub(crate) tick: Duration,
    /// The time from the tick to the command.
    pub(crate) took: Duration,
    /// The boxes behind the plan, or `None` for a safe stop.
    pub(crate) seen: Option<Seen>,
}

/// Holds the figures of a drive that the table shows.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Figures {
    /// Streaming AP50, in percent.
    pub(crate) ap50: f64,
    /// The share of all ticks, in percent, whose data is older than the end-to-end deadline; a safe
    /// stop has no data.
    pub(crate) old: f64,
    /// The median and the 99th percentile of the data's age, over the ticks that have data.
    pub(crate) ages: [Duration; 2],
    pub(crate) stops: usize,
}

impl Figures {
    pub(crate) fn of(recording: &Recording, commands: &[Command], deadline: Duration) -> Self {
        let age = |command: &Command| {
            Some(command.tick.saturating_sub(Recording::captured(command.seen?.frame)))
        };
        let mut ages: Vec<Duration> = commands.iter().filter_map(age).collect();
        ages.sort_unstable();
        let percentile = |percent: usize| ages.get(ages.len() * percent / 100).copied();
        let scored = commands.iter().map(|command| {
            let found = command.seen.into_iter().flat_map(|seen| recording.boxes(seen));
            (found.copied().collect(), recording.reference(recording.newest(command.tick)))
        });
        Self {
            ap50: ap50(scored),
            old: percent(ages.iter().filter(|age| **age > deadline).count(), commands.len()),
            ages: [50, 99].map(|at| percentile(at).unwrap_or_default()),
            stops: commands.len() - ages.len(),
        }
    }
}

/// Returns the average precision in percent over ticks, each with its boxes and its people.
pub(crate) fn ap50<'a>(ticks: impl Iterator<Item = (Vec<[f64; 5]>, &'a [Corners])>) -> f64 {
    let (mut boxes, mut people_count) = (Vec::new(), 0);
    for (found, people) in ticks {
        people_count += people.len();
        boxes.extend(matches(found, people));
    }
    boxes.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    // The number of right boxes so far, and their share.
    let mut points = Vec::new();
    let mut right_count = 0;
    for (number, (_, is_right)) in boxes.into_iter().enumerate() {
        right_count += usize::from(is_right);
        points.push((right_count, percent(right_count, number + 1)));
    }
    let mut greatest = 0.0_f64;
    for (_, precision) in points.iter_mut().rev() {
        greatest = greatest.max(*precision);
        *precision = greatest;
    }
    let at = |recall: usize| {
        let first = points.partition_point(|(right, _)| right * 100 < recall * people_count);
        points.get(first).map_or(0.0, |(_, precision)| *precision)
    };
    (0..=100).map(at).sum::<f64>() / 101.0
}

/// Returns each box's score and whether the box is right, by falling score.
fn matches(mut found: Vec<[f64; 5]>, people: &[Corners]) -> Vec<(f64, bool)> {
    found.sort_by(|one, other| other[4].total_cmp(&one[4]));
    let mut is_free = vec![true; people.len()];
    let take = |[left, top, right, bottom, score]: [f64; 5]| {
        let shared = |person: &Corners| overlap([left, top, right, bottom], *person);
        let free = (0..people.len()).filter(|person| is_free[*person]);
        let overlaps = free.map(|person| (shared(&people[person]), person));
        let most = overlaps.max_by(|(one, _), (other, _)| one.total_cmp(other));
        let taken = most.filter(|(shared, _)| *shared >= 0.5);
        if let Some((_, person)) = taken {
            is_free[person] = false;
        }
        (score, taken.is_some())
    };
    found.into_iter().map(take).collect()
}

/// Returns the overlap of two boxes (`IoU`).
fn overlap(one: Corners, other: Corners) -> f64 {
    let area =
        |[left, top, right, bottom]: Corners| (right - left).max(0.0) * (bottom - top).max(0.0);
    let common = area([
        one[0].max(other[0]),
        one[1].max(other[1]),
        one[2].min(other[2]),
        one[3].min(other[3]),
    ]);
    common / (area(one) + area(other) - common)
}

/// Returns a part of a whole in percent, or 0 if the whole is 0.
fn percent(part: usize, whole: usize) -> f64 {
    let float = |count: usize| f64::from(u32::try_from(count).unwrap_or(u32::MAX));
    if whole == 0 { 0.0 } else { 100.0 * float(part) / float(whole) }
}
