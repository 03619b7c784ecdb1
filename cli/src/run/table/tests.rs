//! Tests that the tables mark bounds as such, and that bounds still hold after rounding.

use std::collections::BTreeMap;
use std::ffi::OsString;

use fuseline_traces::{Commit, Header, Judge};

use super::*;

/// Returns the figures between which the true one lies according to a cell. `?` allows any figure.
fn figures_of(cell: &str, whole: f64) -> (f64, f64) {
    let cell = cell.trim_end_matches(" %").trim_end_matches(" ms").trim_end_matches(" MB");
    let number = |text: &str| text.trim().parse::<f64>().expect("a number");
    match (cell, cell.split_once('–')) {
        ("?", _) => (0.0, whole),
        (_, Some((least, most))) => (number(least), number(most)),
        _ if cell.starts_with('≥') => (number(cell.trim_start_matches('≥')), whole),
        _ if cell.starts_with('≤') => (0.0, number(cell.trim_start_matches('≤'))),
        _ => (number(cell), number(cell)),
    }
}

/// A bound holds as it is written, and only a known figure is written as exact (D11).
#[test]
fn a_bound_holds_as_it_is_written_and_only_what_is_known_is_written_as_exact() {
    for messages in [1, 3, 7, 20, 333] {
        for at_least in 0..=messages {
            for at_most in at_least..=messages {
                let cell = in_time(BoundedFigure { at_least, at_most }, messages);
                let (least, most) = figures_of(&cell, 100.0);
                let [of_least, of_most] = [at_least, at_most].map(|it| 100.0 * share(it, messages));
                let case = format!("{at_least} to {at_most} of {messages}: {cell}");
                if at_least == at_most {
                    assert!(
                        (least - of_least).abs() <= 0.051 && least.to_bits() == most.to_bits(),
                        "{case}"
                    );
                } else {
                    assert!(least <= of_least && most >= of_most && most > least, "{case}");
                    assert!(of_least - least < 0.11 && most - of_most < 0.11, "{case}");
                }
                let ap = mean_ap(BoundedFigure { at_least: of_least, at_most: of_most });
                let (least, most) = figures_of(&ap, 100.0);
                assert!(least <= of_least + 0.051 && most >= of_most - 0.051, "{case}: {ap}");
                assert_eq!(at_least == at_most, least.to_bits() == most.to_bits(), "{case}: {ap}");
            }
        }
    }
}

/// Each figure of a row that is a bound is marked (D11).
#[test]
fn each_figure_of_a_row_that_is_a_bound_is_marked() {
    let ms = Duration::from_millis;
    for marks in 0..32_u32 {
        let is_bound = |index: u32| marks & (1 << index) != 0;
        let quantile = |index, at| {
            Some(if is_bound(index) { Quantile::AtLeast(at) } else { Quantile::Exactly(at) })
        };
        let policy = PolicyReport {
            policy: "p".to_owned(),
            mean_ap: Some(BoundedFigure::exactly(40.0)),
            in_time: BoundedFigure::exactly(9),
            response_ms: [quantile(0, ms(94)), quantile(1, ms(150)), quantile(2, ms(199))],
            outage_response_ms: quantile(3, ms(500)),
            sent_bytes: 1_240_000,
            sent_is_at_least: is_bound(4),
        };
        assert_eq!(policy.has_bounds(), marks > 0);
        let figures = ["94 ms", "150 ms", "199 ms", "500 ms", "1.2 MB"].into_iter().zip(0..);
        let figures =
            figures.map(
                |(figure, index)| {
                    if is_bound(index) { format!("≥ {figure}") } else { figure.to_owned() }
                },
            );
        let expected = ["p", "40.0", "90.0 %"].map(ToOwned::to_owned).into_iter().chain(figures);
        assert_eq!(policy.row(10), expected.collect::<Vec<_>>());
    }
}

/// A source's share counts all messages that came, including refused and missed ones (D11).
#[test]
fn a_source_has_its_share_of_all_messages() {
    let row = |p, forwarded| {
        let mut counts = [0; COLUMNS.len()];
        counts[1] = forwarded;
        RequestRow { p, counts, response: [None; 3] }
    };
    let totals = Totals {
        messages: 40,
        forwarded: 30,
        missed: 3,
        refused: 5,
        open: 2,
        response: [None; 3],
        rows: vec![row(0, 10), row(1, 4), row(2, 16)],
    };
    let table = sources_table(&totals, |row| format!("source {}", row.p));
    for (source, share) in [(0, "25.0 %"), (1, "10.0 %"), (2, "40.0 %")] {
        let line = table.lines().find(|line| line.contains(&format!("source {source}")));
        assert!(line.is_some_and(|line| line.contains(share)), "{table}");
    }
    let sentence = MessagesSentence(&totals).to_string();
    assert_eq!(sentence, "40 messages: 30 forwarded, 3 missed, 5 refused, 2 open");
}

/// Returns the plan of a run with these options.
pub(crate) fn plan(args: &[&str]) -> RunPlan {
    let args = ["fuseline", "run"].iter().chain(args).map(OsString::from);
    let (crate::Command::Run(args), _) = crate::parse(&args.collect::<Vec<_>>()).unwrap() else {
        panic!("it is no run")
    };
    RunPlan::new(&args).unwrap()
}

/// Returns the lines of a text, with the space between words normalized.
fn lines(text: &str) -> Vec<String> {
    text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
}

const OWN: [&str; 24] = [
    "--policy",
    "constant",
    "--workers",
    "1",
    "--local",
    "mine,runtime=50ms",
    "--rate",
    "2.5",
    "--for",
    "1.5s",
    "--deadline",
    "80ms",
    "--uplink",
    "20",
    "--link-queue",
    "300",
    "--cloud",
    "name=a,priority=3,model=my,runtime=45ms,drive=cicv5g/rural_n8_v0,start=1.5s",
    "--window",
    "5",
    "--calls",
    "2",
    "--commit",
    "patient",
];

#[test]
fn a_plan_is_described_as_it_was_chosen() {
    let real = [
        "Requests of 33.3 KB and replies of 1.0 KB are real gRPC.",
        "Local and clouds with a drive are emulated: the paper's runtimes ±5 % (seed 1), recorded networks.",
    ];
    assert_eq!(
        lines(&PlanSummary(&plan(&[])).to_string()),
        [
            "A camera takes 10 frames a second for 30 s; each cloud gets every frame and has at most 500 ms.",
            "0 local DETR-ResNet-50 on Orin 301.7 ms pipelined over 4 workers, one does 3.3 a second",
            "1 west DETR-ResNet-101 on A100 118.2 ms cicv5g/rural_n8_v10 from 62 s",
            "2 east DINO-SWIN-Tiny on A100 90.1 ms vnperf/highway:sprint from 150 s",
            real[1],
            real[0],
            "These drives leave no reply in time: west 11.6–22.8 s, east 14.0–30.0 s, both 14.0–22.8 s.",
        ]
    );
    assert_eq!(
        lines(&PlanSummary(&plan(&OWN)).to_string()),
        [
            "A camera takes 2.5 frames a second for 1.5 s; each cloud gets every frame and has 80 ms.",
            "0 local mine 50.0 ms one worker, 20.0 a second",
            "3 a my 45.0 ms cicv5g/rural_n8_v0 from 1.5 s",
            "Local and clouds with a drive are emulated: the given runtimes ±5 % (seed 1), recorded networks.",
            real[0],
            "All clouds share a link: uplink 20 Mbit/s, queues of 300 KB.",
        ]
    );
    let mixed =
        ["--local", "mine,runtime=50ms", "--seed", "7", "--downlink", "0.5", "--uplink", "2"];
    let text = PlanSummary(&plan(&mixed)).to_string();
    assert!(text.contains("the paper's and the given runtimes ±5 % (seed 7)"), "{text}");
    assert!(text.contains("uplink 2 Mbit/s, downlink 0.5 Mbit/s, queues of 4000 KB."), "{text}");
}

#[test]
fn what_a_server_did_not_say_is_reported_with_what_is_known_of_it() {
    let remote = |more: &str, drive: Option<&str>| {
        let cloud = format!("name=a,priority=2,url=http://h:1{more}");
        let mut plan = plan(&["--for", "1s", "--cloud", &cloud]);
        plan.clouds[0].served.describe_error = Some("no answer".to_owned());
        plan.clouds[0].served.drive = drive.map(ToOwned::to_owned);
        lines(&PlanSummary(&plan).to_string())
    };
    let known = remote(",model=DINO-SWIN-Tiny", Some("vnperf/x"));
    assert_eq!(known[2], "2 a DINO-SWIN-Tiny on A100 90.1 ms http://h:1, vnperf/x");
    assert_eq!(
        known[5],
        "a: its server did not say what it serves (no answer); its model is the one that --cloud \
         names."
    );
    let unknown = remote("", None);
    assert_eq!(unknown[2], "2 a http://h:1");
    assert!(unknown[5].ends_with("(no answer); its model is unknown."), "{unknown:?}");
    assert_eq!((known.len(), unknown.len()), (6, 6));
}

#[test]
fn outages_of_a_second_and_more_are_named_up_to_four_of_a_cloud() {
    let seconds = |from: u64, to: u64| Outage {
        from: Duration::from_secs(from),
        to: Duration::from_secs(to),
    };
    let all: Vec<Outage> = (0..6).map(|outage| seconds(3 * outage, 3 * outage + 1)).collect();
    assert_eq!(spans(&all[..1]), "0.0–1.0 s");
    assert_eq!(spans(&all[..4]), "0.0–1.0 s, 3.0–4.0 s, 6.0–7.0 s, 9.0–10.0 s");
    assert_eq!(spans(&all[..5]), "0.0–1.0 s, 3.0–4.0 s, 6.0–7.0 s, 9.0–10.0 s and later");
    let west = ["--drive", "west=cicv5g/rural_n8_v0", "--start", "west=12s", "--for", "17s"];
    // Only the cloud that is out of reach is named.
    assert_eq!(outages(&plan(&west)), "These drives leave no reply in time: east 14.0–17.0 s.\n");
    assert_eq!(outages(&plan(&[&west[..5], &["9s"]].concat())), "");
    let alone = "name=a,priority=2,model=DINO-SWIN-Tiny,drive=vnperf/highway:sprint,start=150s";
    let alone = outages(&plan(&["--cloud", alone, "--for", "17s"]));
    assert_eq!(alone, "These drives leave no reply in time: a 14.0–17.0 s.\n");
}

/// Returns a report in which all figures differ.
fn reported() -> RunReport {
    let row = |p, counts| RequestRow { p, counts, response: [None; 3] };
    let source = |name: &str, priority, failures: &[(&str, u64)], hint| SourceReport {
        name: name.to_owned(),
        priority,
        model: None,
        unsaid: None,
        emulated: false,
        drive: None,
        forwarded: 0,
        share: 0.0,
        requests: BTreeMap::new(),
        failures: failures.iter().map(|(why, count)| ((*why).to_owned(), *count)).collect(),
        hint,
        sent_bytes: 0,
    };
    let totals = Totals {
        messages: 40,
        forwarded: 30,
        missed: 3,
        refused: 7,
        open: 0,
        response: [None; 3],
        rows: vec![row(0, [33, 10, 2, 5, 1, 15, 0, 0]), row(3, [31, 20, 4, 3, 2, 2, 0, 6])],
    };
    let policy = |ap| PolicyReport {
        policy: "fusion".to_owned(),
        mean_ap: ap,
        in_time: BoundedFigure::exactly(9),
        response_ms: [
            None,
            Some(Quantile::Never),
            Some(Quantile::Exactly(Duration::from_millis(7))),
        ],
        outage_response_ms: None,
        sent_bytes: 1_240_000,
        sent_is_at_least: false,
    };
    let header = Header { operator: None, window: 5, commit: Commit::Patient, clouds: Vec::new() };
    RunReport {
        messages: 40,
        interrupted: false,
        page: None,
        rate: 2.5,
        deadline_ms: 80,
        policy: "constant",
        price_per_ms: None,
        commit: "patient",
        window: 5,
        calls: 2,
        seed: 1,
        sources: vec![
            source("local", 0, &[], None),
            source("a", 3, &[("no", 2), ("odd", 1)], Some("mend it")),
        ],
        missed: 3,
        refused: 7,
        open: 0,
        totals,
        timer_lag_ms: None,
        outage_messages: BoundedFigure::exactly(0),
        compared: 10,
        policies: vec![policy(Some(BoundedFigure::exactly(40.04)))],
        trace: Judge::new("t", &header).finish(),
    }
}

#[test]
fn each_figure_of_a_report_stands_where_it_belongs() {
    let report = reported();
    let text = lines(&report.to_string());
    let expected = [
        "source share requests forwarded discarded late failed superseded refused",
        text[1].as_str(),
        "0 local 25.0 % 33 10 2 5 1 15 0",
        "3 a 50.0 % 31 20 4 3 2 2 6",
        "",
        "a: 2 × no, 1 × odd; mend it",
        "",
        "40 messages: 30 forwarded, 3 missed, 7 refused",
        "",
        "policy mean AP in time p50 p90 p99 in outages sent",
        text[1].as_str(),
        "fusion 40.0 90.0 % – never 7 ms – 1.2 MB",
        "",
    ];
    // The first line's line is as long as its table.
    let same = |(index, expected): (usize, &&str)| match index {
        10 => text[index].starts_with('─'),
        _ => text[index] == **expected,
    };
    assert!(expected.iter().enumerate().all(same), "{text:#?}");
    let caveats = text[expected.len()..].join(" ");
    let refused = "All policies have the same limits: a window of 5, gates, and 2 calls to a cloud \
                   at once. They refused 7 messages and 6 requests, so no policy has results for \
                   these.";
    assert!(caveats.contains(refused), "{caveats}");
    assert!(caveats.contains("took 80 ms or more. Progressive sends"), "{caveats}");
    for absent in ["Outages", "A ? under mean AP", "≥, ≤", "timers forward"] {
        assert!(!caveats.contains(absent), "{caveats}");
    }
    let early = RunReport { interrupted: true, ..reported() }.to_string();
    assert!(early.starts_with("Interrupted; this is the run so far.\n\n"), "{early}");
}

#[test]
fn each_caveat_stands_where_it_is_one() {
    type ReportChange = fn(&mut RunReport);
    let caveats = |change: ReportChange| {
        let mut report = reported();
        change(&mut report);
        report.caveats().join(" ").replace('\n', " ")
    };
    let cases: [(ReportChange, &str); 7] = [
        (
            |report| report.outage_messages = BoundedFigure::exactly(1),
            "Outages are the 1 message that at least one cloud would not have answered by then.",
        ),
        (
            |report| report.outage_messages = BoundedFigure { at_least: 0, at_most: 3 },
            "Outages are at most 3 messages that",
        ),
        (
            |report| report.outage_messages = BoundedFigure { at_least: 2, at_most: 3 },
            "Outages are 2 to 3 messages that",
        ),
        (|report| report.policies[0].mean_ap = None, "A ? under mean AP means"),
        (
            |report| report.policies[0].sent_is_at_least = true,
            "≥, ≤, – and a ? under in time mark bounds",
        ),
        (|report| report.timer_lag_ms = Some(1.26), "they fired up to 1.3 ms late."),
        (|report| report.refused = 0, "They refused 0 messages and 6 requests, so no policy"),
    ];
    for (change, expected) in cases {
        assert!(caveats(change).contains(expected), "{expected}: {}", caveats(change));
    }
    let none = caveats(|report| {
        report.refused = 0;
        report.totals.rows.clear();
    });
    assert!(!none.contains("limits"), "{none}");
}

#[test]
fn a_page_has_the_options_in_force_and_all_caveats() {
    let notes = reported().notes(&plan(&OWN));
    let configuration: Vec<(&str, &str)> =
        notes.configuration.iter().map(|(name, value)| (&**name, &**value)).collect();
    assert_eq!(
        configuration,
        [
            ("Camera", "2.5 Hz for 1.5 s"),
            ("Longest deadline", "80 ms"),
            ("Deadline policy", "constant"),
            ("Commit rule", "patient"),
            ("Window", "5"),
            ("Calls to a cloud at once", "2"),
            ("Seed", "1"),
            ("local", "mine, 50.0 ms, 1 at once"),
            ("Link", "uplink 20 Mbit/s, queues of 300 KB."),
            ("a", "priority 3, my 45.0 ms cicv5g/rural_n8_v0 from 1.5 s"),
        ]
    );
    assert_eq!(notes.policies.columns.len(), notes.policies.rows[0].len());
    assert!(notes.caveats.iter().all(|caveat| !caveat.contains("was interrupted")));
    let default = RunReport { interrupted: true, ..reported() }.notes(&plan(&[]));
    assert!(
        default.configuration.contains(&(
            "Deadline policy".to_owned(),
            "expected, 0.01 AP a millisecond".to_owned()
        ))
    );
    assert_eq!(default.caveats.last().unwrap(), "The run was interrupted.");
    let outage = "These drives leave no reply in time: west 11.6–22.8 s, east 14.0–30.0 s, both 14.0–22.8 s.";
    assert!(default.caveats.contains(&outage.to_owned()), "{:?}", default.caveats);
    assert!(default.caveats.iter().all(|caveat| !caveat.contains('\n')));
}

/// A request is open only if the run ends before its message does.
#[test]
fn open_requests_have_a_column_where_there_are_some() {
    let mut totals = reported().totals;
    totals.rows[1].counts[OPEN] = 9;
    let text = lines(&sources_table(&totals, |row| format!("s{}", row.p)));
    assert_eq!(
        text[0],
        "source share requests forwarded discarded late failed superseded open refused"
    );
    assert_eq!(text[3], "s3 50.0 % 31 20 4 3 2 2 9 6");
}
