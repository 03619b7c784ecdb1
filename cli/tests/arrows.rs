//! Arrows of `fuseline export --perfetto`, from operator to operator, for drawn operators whose
//! clocks begin at different instants.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use crate::common::{err, micros, run};
use fuseline_testkit::Rng;
use serde_json::Value;
use tempfile::tempdir;

/// The number of vehicles that are drawn.
const VEHICLES: u64 = 12;
/// The time from a message to its output, in nanoseconds.
const RESPONSE: u64 = 1_000;

/// The frame that an operator's message comes from.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct CameraFrame {
    stream: String,
    seq: u64,
}

/// An operator's message.
struct FrameVisit {
    frame: CameraFrame,
    /// On the clock that all operators share.
    captured: u64,
    opened: u64,
    knows_age: bool,
}

/// Operators in any order; which one knows its frames' ages beside which is a chain, so that each
/// clock is known by others'.
fn vehicle(rng: &mut Rng) -> Vec<(u64, Vec<FrameVisit>)> {
    let count = rng.usize(2..6);
    let mut operators: Vec<(u64, Vec<FrameVisit>)> =
        (0..count).map(|_| (rng.u64(0..5_000_000_000), Vec::new())).collect();
    let mut order: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        order.swap(last, rng.usize(0..last + 1));
    }
    let mut see = |of: &[usize], stream: String, seq: u64, knows_age: bool| {
        let captured = 6_000_000_000 + rng.u64(0..3_000_000_000);
        for operator in of {
            // Perhaps it gets the frame once more.
            for _ in 0..=rng.u64(0..5) / 4 {
                let (frame, opened) =
                    (CameraFrame { stream: stream.clone(), seq }, rng.u64(1..900_000_000));
                let visit = FrameVisit { frame, captured, opened: captured + opened, knows_age };
                operators[*operator].1.push(visit);
            }
        }
    };
    for (link, pair) in order.windows(2).enumerate() {
        for seq in 0..3 {
            see(pair, format!("camera {link}"), seq, true);
        }
    }
    for seq in 0..4 {
        see(&order, "of all".to_owned(), seq, false);
        see(&order[..1], "of one".to_owned(), seq, true);
    }
    for (_, visits) in &mut operators {
        visits.sort_by_key(|visit| visit.opened);
    }
    operators
}

/// An operator's trace, on its own clock.
fn trace((start, visits): &(u64, Vec<FrameVisit>)) -> String {
    let mut text = "{\"fuseline\":1,\"window\":1024,\"clouds\":[]}\n".to_owned();
    for (t, visit) in visits.iter().enumerate() {
        let FrameVisit { frame: CameraFrame { stream, seq }, captured, opened, knows_age } = visit;
        let age = opened - captured;
        let age = if *knows_age { format!("\"age\":{age},") } else { String::new() };
        let (at, end) = (opened - start, opened - start + RESPONSE);
        let origin = format!("\"origin\":\"{stream}\",\"seq\":{seq}");
        text.extend([format!("{{\"ev\":\"open\",\"at\":{at},\"t\":{t},{age}{origin}}}\n")]);
        for ev in ["result", "emit"] {
            text.extend([format!("{{\"ev\":\"{ev}\",\"at\":{end},\"t\":{t},\"p\":0}}\n")]);
        }
    }
    text
}

/// An arrow's end at a message: its phase, its process, when, of which frame.
type ArrowEnd = (String, u64, String, String);

/// The arrows that a vehicle's frames should have, an entry each.
fn expected(operators: &[(u64, Vec<FrameVisit>)]) -> BTreeSet<Vec<ArrowEnd>> {
    let first = operators.iter().map(|(start, _)| *start).min().unwrap();
    let mut visits: BTreeMap<&CameraFrame, Vec<(u64, u64)>> = BTreeMap::new();
    for (pid, (_, own)) in (1..).zip(operators) {
        for FrameVisit { frame, opened, .. } in own {
            let of = visits.entry(frame).or_default();
            if of.iter().all(|(_, other)| *other != pid) {
                of.push((*opened, pid));
            }
        }
    }
    let arrows = visits.into_iter().filter(|(_, visits)| visits.len() > 1);
    let arrows = arrows.map(|(CameraFrame { stream, seq }, mut visits)| {
        visits.sort_unstable();
        let last = visits.len() - 1;
        let ends = visits.iter().enumerate().map(|(place, (opened, pid))| {
            let phase = if place == 0 { "s" } else { ["t", "f"][usize::from(place == last)] };
            (phase.to_owned(), *pid, micros(opened - first), format!("{stream} {seq}"))
        });
        ends.collect()
    });
    arrows.collect()
}

#[test]
fn arrows_lead_each_frame_through_its_operators_on_one_clock() {
    let mut rng = Rng::with_seed(7);
    for _ in 0..VEHICLES {
        let operators = vehicle(&mut rng);
        let dir = tempdir().unwrap();
        let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        let mut args = vec!["export".to_owned(), "--perfetto".to_owned()];
        for (number, operator) in operators.iter().enumerate() {
            let path = path(&number.to_string());
            fs::write(&path, trace(operator)).unwrap();
            args.push(path);
        }
        args.extend(["-o".to_owned(), path("out")]);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let exported = run(&args, "");
        assert_eq!((exported.status.code(), err(&exported)), (Some(0), ""));
        let text = fs::read_to_string(path("out")).unwrap();
        check(&text, &operators);
    }
}

fn check(text: &str, operators: &[(u64, Vec<FrameVisit>)]) {
    let (mut slices, mut arrows) = (BTreeSet::new(), BTreeMap::<u64, Vec<ArrowEnd>>::new());
    let mut on_slices = Vec::new();
    for line in text.lines().map(|line| line.trim_end_matches(',')) {
        let Ok(event) = serde_json::from_str::<Value>(line) else { continue };
        let number = |key: &str| event[key].as_u64().unwrap();
        // As text, for a float holds no nanoseconds.
        let Some(times) = line.strip_prefix("{\"ts\":") else { continue };
        let at = times.split(',').next().unwrap().to_owned();
        let (pid, tid) = (number("pid"), number("tid"));
        match event["ph"].as_str().unwrap() {
            "X" => assert!(slices.insert((pid, tid, at))),
            "i" => {}
            phase => {
                assert_eq!(event["bp"] == "e", phase == "f", "{line}");
                let name = event["name"].as_str().unwrap().to_owned();
                let ends = arrows.entry(number("id")).or_default();
                ends.push((phase.to_owned(), pid, at.clone(), name));
                on_slices.push((pid, tid, at));
            }
        }
    }
    // Each end is on the slice of a message that begins there.
    assert!(on_slices.iter().all(|end| slices.contains(end)), "{on_slices:?} of {slices:?}");
    let first = operators.iter().map(|(start, _)| *start).min().unwrap();
    let begins = (1..).zip(operators).flat_map(|(pid, (_, visits))| {
        visits.iter().map(move |visit| (pid, micros(visit.opened - first)))
    });
    let shown: BTreeSet<_> = slices.into_iter().map(|(pid, _, at)| (pid, at)).collect();
    assert_eq!(shown, begins.collect::<BTreeSet<_>>());
    let in_order = arrows.into_values().map(|mut ends| {
        ends.sort_by_key(|(_, _, at, _)| {
            at.split_once('.').map(|(whole, part)| (whole.len(), whole.to_owned(), part.to_owned()))
        });
        ends
    });
    assert_eq!(in_order.collect::<BTreeSet<_>>(), expected(operators));
}
