//! Judges every trace of the corpus: conforming ones conform, and breaking ones break what their
//! sidecars name.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use fuseline_traces::corpus::CASES;
use fuseline_traces::observed::{self, Slack};
use fuseline_traces::{
    Commit, Decision, Doubt, DoubtKind, DropReason, Event, Events, ExpectedDecisions, Header,
    HeldValues, Input, Judge, Line, OfferRefusal, OpenRefusal, Reference, Rule, Verdict, judge,
    parse,
};
use serde::Deserialize;

/// The rule that a breaking trace breaks, and the line.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sidecar {
    rule: String,
    line: u64,
}

/// States how a trace is judged when more is known of its run, and what is found.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Options {
    observed: Option<Observed>,
    #[serde(default)]
    ended: bool,
    period: Option<u64>,
    judged: u64,
    violations: Vec<Sidecar>,
    /// `true` if the last line is cut off.
    #[serde(default)]
    truncated: bool,
    /// The number of messages, requests or lines in each kind of doubt.
    #[serde(default)]
    doubts: BTreeMap<String, u64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Observed {
    tolerance: u64,
    lateness: u64,
    /// The tolerances of single sources.
    #[serde(default)]
    tolerances: BTreeMap<u64, u64>,
}

/// A reason with the kind of input that it is for; the kinds are counted separately.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Reason {
    Open(OpenRefusal),
    Offer(OfferRefusal),
    Result(DropReason),
    Fail(DropReason),
}

#[test]
fn conforming_traces_conform() {
    for case in CASES {
        let verdict = judge(case.name, case.trace.as_bytes()).expect("it can be read");
        assert_eq!(verdict.violations, [], "{verdict}");
        // Two kinds are about messages without any further line.
        let kinds = verdict.doubts.iter().map(|doubt| doubt.kind.as_str());
        assert!(verdict.conforms || kinds.eq(["unjudged"]), "{verdict}");
    }
}

/// Each kind of doubt has a case, and accepting the kind makes the trace conform.
#[test]
fn doubts_are_those_of_their_sidecars() {
    let folder = corpus().join("doubts");
    let mut kinds = BTreeSet::new();
    for name in names_in(&folder) {
        let options = fs::read(folder.join(format!("{name}.json"))).expect("it has a sidecar");
        let options: Options = serde_json::from_slice(&options).expect("it is a sidecar");
        let mut trace = fs::read(folder.join(format!("{name}.jsonl"))).expect("it can be read");
        let mut expected = options.doubts.clone();
        if options.truncated {
            // The reader of the trace knows that it is cut.
            assert!(!trace.ends_with(b"\n"), "{name}");
            trace.truncate(trace.iter().rposition(|byte| *byte == b'\n').unwrap() + 1);
            expected.remove("cut").expect("it is cut");
        }
        let (found, conforms) = doubts(&options, &trace);
        assert_eq!(found, expected, "{name}");
        assert_eq!(conforms, (found.is_empty(), true), "{name}");
        let about = name.split('-').next().unwrap_or_default();
        assert!(options.doubts.contains_key(about) || options.doubts.is_empty(), "{name}");
        kinds.extend(options.doubts.into_keys());
    }
    assert_eq!(kinds, DoubtKind::ALL.map(|kind| kind.as_str().to_owned()).into());
}

/// Returns the doubts with their counts, and whether the trace conforms, without and with accepting
/// them.
fn doubts(options: &Options, trace: &[u8]) -> (BTreeMap<String, u64>, (bool, bool)) {
    let verdict = judged(options, trace);
    let counts = verdict.doubts.iter().map(|doubt| (doubt.kind.as_str().to_owned(), doubt.count));
    let (counts, conforms) = (counts.collect(), verdict.conforms);
    (counts, (conforms, verdict.accepting(&DoubtKind::ALL).conforms))
}

#[test]
fn bad_traces_break_only_the_named_rule() {
    let mut astray = Vec::new();
    for (path, sidecar) in bad() {
        let verdict = verdict(&path);
        let found: Vec<_> =
            verdict.violations.iter().map(|found| (found.rule.id(), found.line)).collect();
        if found != [(&*sidecar.rule, sidecar.line)] {
            astray.push(verdict.to_string());
        }
    }
    assert!(astray.is_empty(), "{}", astray.join("\n\n"));
}

/// These traces conform by their lines alone; knowing that the run has ended, or its period,
/// changes the verdict (A44, A45, J1).
#[test]
fn traces_of_which_more_is_known_are_judged_by_that() {
    let folder = corpus().join("options");
    let names = names_in(&folder);
    assert!(names.len() > 5, "{names:?}");
    for name in names {
        let options = fs::read(folder.join(format!("{name}.json"))).expect("it has a sidecar");
        let options: Options = serde_json::from_slice(&options).expect("it is a sidecar");
        let trace = fs::read(folder.join(format!("{name}.jsonl"))).expect("it can be read");
        assert!(conforms_alone(&options, &trace), "{name}");
        let (judged, unfinished, found) = with_options(&options, &trace);
        let expected = options.violations.iter().map(|it| (it.rule.clone(), it.line)).collect();
        let left = options.doubts.get("unfinished").copied().unwrap_or_default();
        assert_eq!((judged, unfinished, found), (options.judged, left, expected), "{name}");
    }
}

/// Judges values, attempts, a message's own deadline, an absent local and clocks that differ (A46
/// to A50, D2, D18, J2). The sidecar says how a trace is judged; a trace without a violation in it
/// conforms.
#[test]
fn traces_with_further_keys_are_judged_by_them() {
    assert!(judged_as_their_sidecars_say("annotated") > 15);
}

/// Judges recordings of concurrent implementations under progressive (A54, F9).
#[test]
fn observed_traces_are_judged_under_progressive() {
    assert!(judged_as_their_sidecars_say("observed") > 5);
}

/// Judges the traces of a folder and returns their number.
fn judged_as_their_sidecars_say(folder: &str) -> usize {
    let folder = corpus().join(folder);
    let names = names_in(&folder);
    for name in &names {
        let options = fs::read(folder.join(format!("{name}.json"))).expect("it has a sidecar");
        let options: Options = serde_json::from_slice(&options).expect("it is a sidecar");
        let trace = fs::read(folder.join(format!("{name}.jsonl"))).expect("it can be read");
        let (judged, unfinished, mut found) = with_options(&options, &trace);
        found.sort_by_key(|(_, line)| *line);
        let expected = options.violations.iter().map(|it| (it.rule.clone(), it.line)).collect();
        let left = options.doubts.get("unfinished").copied().unwrap_or_default();
        assert_eq!((judged, unfinished, found), (options.judged, left, expected), "{name}");
    }
    names.len()
}

/// A replay writes the value keys of traces that conform strictly.
#[test]
fn an_emit_says_of_its_value_what_its_result_said() {
    let mut emits = 0;
    for name in ["d2-emit-has-the-value-of-its-result", "d2-value-within-the-max-age"] {
        let trace = fs::read_to_string(corpus().join(format!("annotated/{name}.jsonl"))).unwrap();
        let mut reader = Events::new(name, trace.as_bytes()).expect("it has a header");
        let mut machine = Reference::new(reader.header());
        let (mut values, mut demands) = (HeldValues::default(), ExpectedDecisions::new());
        let mut written = format!("{}\n", trace.lines().next().unwrap());
        while let Some(event) = reader.next_event().expect("it is well formed") {
            let Event::Input(input) = event else { continue };
            written.push_str(&event.annotated(reader.annotations()));
            written.push('\n');
            demands.clear();
            machine.apply(&input, &mut demands);
            values.apply(&input, reader.annotations().value(), demands.iter().map(|(it, _)| it));
            for (decision, _) in &demands {
                let sent = values.sent(decision);
                emits += u64::from(!sent.is_empty());
                written.push_str(&Event::Decision(*decision).annotated(&sent.into()));
                written.push('\n');
            }
        }
        assert_eq!(written, trace);
    }
    assert_eq!(emits, 6);
}

/// Returns `true` if the trace conforms when nothing more is known.
fn conforms_alone(options: &Options, trace: &[u8]) -> bool {
    match &options.observed {
        None => judge("trace", trace).expect("it is well formed").violations.is_empty(),
        Some(slack) => {
            let slack = Slack { tolerance: slack.tolerance, lateness: slack.lateness };
            observed::judge("trace", slack, trace).expect("it is well formed").violations.is_empty()
        }
    }
}

/// The numbers of judged and of unfinished timestamps, and the violations.
type FoundByOption = (u64, u64, Vec<(String, u64)>);

fn with_options(options: &Options, trace: &[u8]) -> FoundByOption {
    let verdict = judged(options, trace);
    let found = verdict.violations.iter().map(|it| (it.rule.to_string(), it.line));
    (verdict.judged, unfinished(&verdict.doubts), found.collect())
}

fn unfinished(doubts: &[Doubt]) -> u64 {
    let mut of_kind = doubts.iter().filter(|doubt| doubt.kind == DoubtKind::Unfinished);
    of_kind.next().map_or(0, |doubt| doubt.count)
}

fn judged(options: &Options, trace: &[u8]) -> Verdict {
    let Some(slack) = &options.observed else {
        assert_eq!(options.period, None, "a period is of observed traces");
        let mut reader = Events::new("trace", trace).expect("it has a header");
        let mut judge = Judge::new("trace", reader.header())
            .with_header_annotations(reader.header_annotations());
        while let Some(event) = reader.next_event().expect("it is well formed") {
            judge.annotated_line(reader.line(), &event, reader.annotations());
        }
        return if options.ended { judge.finish_ended() } else { judge.finish() };
    };
    let tolerances = &slack.tolerances;
    let slack = Slack { tolerance: slack.tolerance, lateness: slack.lateness };
    let mut reader = Events::observed("trace", trace).expect("it has a header");
    let mut judge = observed::Judge::new("trace", reader.header(), slack)
        .with_header_annotations(reader.header_annotations());
    for (p, tolerance) in tolerances {
        judge = judge.with_tolerance_of(*p, *tolerance);
    }
    if let Some(period) = options.period {
        judge = judge.with_period(period);
    }
    while let Some(event) = reader.next_event().expect("it is well formed") {
        let line = judge.annotated_line(reader.line(), &event, reader.annotations());
        line.expect("it is in order");
    }
    if options.ended { judge.finish_ended() } else { judge.finish() }
}

#[test]
fn the_crate_brings_every_conforming_file() {
    let names: Vec<_> = CASES.iter().map(|case| case.name.to_owned()).collect();
    assert_eq!(names, names_in(&corpus()));
}

#[test]
fn names_begin_with_the_rule_that_they_are_about() {
    for (path, sidecar) in bad() {
        let name = name(&path);
        let about = name.split('-').next().unwrap_or_default();
        assert!(sidecar.rule.eq_ignore_ascii_case(about), "{name} breaks {}", sidecar.rule);
    }
}

#[test]
fn every_rule_is_obeyed_and_broken() {
    let mut obeyed: BTreeSet<Rule> = BTreeSet::new();
    for case in CASES {
        for (input, demands) in play(case.trace) {
            obeyed.extend(demands.iter().map(|(_, rule)| *rule));
            // The clock went back, which shows F0.
            if demands.iter().any(|(decision, _)| decision.at() != input.at()) {
                obeyed.insert(Rule::F0);
            }
            // An accepted failure that decides nothing is the only trace of F4.
            if matches!(input, Input::Fail { .. }) {
                obeyed.insert(Rule::F4);
            }
            // An input for a timestamp that was forwarded or missed shows P1.
            if demands.iter().any(|(decision, _)| {
                matches!(decision, Decision::Drop { why: DropReason::Superseded, .. })
            }) {
                obeyed.insert(Rule::P1);
            }
        }
    }
    let broken: BTreeSet<Rule> = bad()
        .iter()
        .map(|(_, sidecar)| Rule::named(&sidecar.rule).expect("the sidecar names a rule"))
        .collect();
    let all = BTreeSet::from(Rule::OF_DECISIONS);
    assert_eq!(obeyed, all);
    assert_eq!(broken, all);
}

#[test]
fn every_reason_is_given_and_withheld() {
    let given: BTreeSet<Reason> = CASES
        .iter()
        .flat_map(|case| play(case.trace))
        .flat_map(|(input, demands)| {
            demands.into_iter().filter_map(move |(decision, _)| reason(&input, &decision))
        })
        .collect();
    let withheld: BTreeSet<Reason> = bad()
        .iter()
        .filter_map(|(path, sidecar)| {
            let expected = &verdict(path).violations.first()?.expected.clone();
            let Ok(Line::Event(Event::Decision(decision))) = parse(expected.as_bytes()) else {
                return None;
            };
            let text = fs::read_to_string(path).expect("it can be read");
            let lines = usize::try_from(sidecar.line).expect("it is small");
            let inputs = text.lines().take(lines).filter_map(|line| input(line.as_bytes()));
            reason(&inputs.last()?, &decision)
        })
        .collect();
    let mut all = BTreeSet::new();
    all.extend(OpenRefusal::ALL.map(Reason::Open));
    all.extend(OfferRefusal::ALL.map(Reason::Offer));
    for why in DropReason::ALL {
        all.extend([Reason::Result(why), Reason::Fail(why)]);
    }
    assert_eq!(given, all);
    assert_eq!(withheld, all);
}

#[test]
fn corpus_shows_where_commit_rules_differ() {
    let mut differ = BTreeSet::new();
    for case in CASES {
        let Some(stem) = case.name.strip_suffix("-eager") else { continue };
        let twin = CASES.iter().find(|twin| twin.name == format!("{stem}-patient"));
        let twin = twin.unwrap_or_else(|| panic!("{stem} has no patient twin"));
        assert_eq!(header(case.trace).commit, Commit::Eager);
        assert_eq!(header(twin.trace).commit, Commit::Patient);
        let (eager, patient) = (play(case.trace), play(twin.trace));
        let inputs = |run: &[(Input, ExpectedDecisions)]| {
            run.iter().map(|(input, _)| *input).collect::<Vec<_>>()
        };
        assert_eq!(inputs(&eager), inputs(&patient), "{stem}");
        if eager != patient {
            differ.extend(stem.split('-').next());
        }
    }
    assert_eq!(differ, BTreeSet::from(["f3", "f5", "f6", "f7"]));
    for rule in ["f5", "f6"] {
        for commit in Commit::ALL {
            let broken = |name: &String| name.starts_with(rule) && name.ends_with(commit.as_str());
            assert!(names_in(&corpus().join("bad")).iter().any(broken), "{rule} under {commit}");
        }
    }
}

#[test]
fn decisions_are_written_as_the_writer_writes_them() {
    for case in CASES {
        for line in case.trace.lines() {
            if let Ok(Line::Event(Event::Decision(decision))) = parse(line.as_bytes()) {
                assert_eq!(line, decision.to_string(), "{}", case.name);
            }
        }
    }
}

fn reason(input: &Input, decision: &Decision) -> Option<Reason> {
    match (input, decision) {
        (_, Decision::RefuseOpen { why, .. }) => Some(Reason::Open(*why)),
        (_, Decision::RefuseOffer { why, .. }) => Some(Reason::Offer(*why)),
        (Input::Fail { .. }, Decision::Drop { why, .. }) => Some(Reason::Fail(*why)),
        (_, Decision::Drop { why, .. }) => Some(Reason::Result(*why)),
        _ => None,
    }
}

/// Returns the inputs of a trace with the decisions that the rules demand.
fn play(trace: &str) -> Vec<(Input, ExpectedDecisions)> {
    let mut reference = Reference::new(&header(trace));
    let inputs = trace.lines().filter_map(|line| input(line.as_bytes()));
    inputs
        .map(|input| {
            let mut demands = ExpectedDecisions::new();
            reference.apply(&input, &mut demands);
            (input, demands)
        })
        .collect()
}

fn input(line: &[u8]) -> Option<Input> {
    match parse(line).expect("it is a line") {
        Line::Event(Event::Input(input)) => Some(input),
        Line::Event(Event::Decision(_)) | Line::Header(_) => None,
    }
}

fn header(trace: &str) -> Header {
    Events::new("trace", trace.as_bytes()).expect("it begins with a header").header().clone()
}

fn verdict(path: &Path) -> Verdict {
    let trace = fs::read(path).expect("it can be read");
    judge(&name(path), &trace[..]).expect("it is well formed")
}

fn bad() -> Vec<(PathBuf, Sidecar)> {
    let folder = corpus().join("bad");
    let names = names_in(&folder);
    assert!(!names.is_empty());
    names
        .into_iter()
        .map(|name| {
            let sidecar = fs::read(folder.join(format!("{name}.json"))).expect("it has a sidecar");
            let sidecar = serde_json::from_slice(&sidecar).expect("it is a sidecar");
            (folder.join(format!("{name}.jsonl")), sidecar)
        })
        .collect()
}

fn names_in(folder: &Path) -> Vec<String> {
    let files =
        fs::read_dir(folder).expect("it is a folder").map(|file| file.expect("it is").path());
    let mut names: Vec<_> = files
        .filter(|path| path.extension().is_some_and(|extension| extension == "jsonl"))
        .map(|path| name(&path))
        .collect();
    names.sort();
    names
}

fn name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus")
}
