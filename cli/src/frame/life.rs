//! What is known of one frame: when each operator took it in, who answered, and what lies between.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use fuseline_traces::{Annotations, Decision, Event, Header, Input, Origin};

/// One operator's message of the frame. Times are since the capture.
#[derive(Clone, Debug)]
pub(super) struct FrameStage {
    pub(super) operator: String,
    pub(super) taken_in: Duration,
    /// None if the trace ends before.
    pub(super) answered: Option<Duration>,
    pub(super) outcome: FrameOutcome,
    /// The inputs of joins on its way that nothing came from.
    pub(super) missing: Vec<Arc<str>>,
    /// How many more messages the operator had of the frame: control has one a tick of the same plan.
    pub(super) more: usize,
    /// Local's computation and the calls of clouds, from their beginning on, and how each ended.
    pub(super) calls: Vec<FrameCall>,
}

/// What an operator answered.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum FrameOutcome {
    Open,
    By(String),
    Missed,
    Refused(String),
}

/// One source's part in a message.
#[derive(Clone, Debug)]
pub(super) struct FrameCall {
    p: u64,
    pub(super) source: String,
    pub(super) begun: Duration,
    pub(super) ended: Option<Duration>,
    pub(super) how: &'static str,
}

/// A frame through all operators, in the order in which they took it in.
pub(super) struct FrameLife {
    pub(super) frame: FrameId,
    pub(super) stages: Vec<FrameStage>,
}

/// A sensor's message: the stream and its timestamp there.
pub(super) type FrameId = (Arc<str>, u64);

/// Looks for frames' messages in one trace.
pub(super) struct MessageSearch<'a> {
    seq: Option<u64>,
    stream: Option<&'a str>,
    operator: String,
    names: BTreeMap<u64, String>,
    /// By timestamp, with when the frame was captured by the trace's clock.
    found: BTreeMap<u64, (FrameId, i128, FrameStage)>,
    /// Those that were refused.
    refused: Vec<(FrameId, FrameStage)>,
    /// Whether the latest open is of a timestamp that was found before: it is about to be refused (F1).
    is_repeated: bool,
    /// Messages whose ages are unknown.
    pub(super) without_age: u64,
}

impl FrameLife {
    pub(super) fn new(frame: FrameId, mut stages: Vec<FrameStage>) -> Self {
        stages.sort_by_key(|stage| (stage.taken_in, stage.answered));
        let mut first = Vec::<FrameStage>::new();
        for stage in stages {
            match first.iter_mut().find(|known| known.operator == stage.operator) {
                Some(known) => known.more += 1,
                None => first.push(stage),
            }
        }
        Self { frame, stages: first }
    }

    /// By how many operators it was missed or refused.
    pub(super) fn unanswered(&self) -> usize {
        let is_missed = |stage: &&FrameStage| {
            matches!(stage.outcome, FrameOutcome::Missed | FrameOutcome::Refused(_))
        };
        self.stages.iter().filter(is_missed).count()
    }

    /// What its time went to, one after the other: in an operator, or before it.
    pub(super) fn spans(&self) -> Vec<(String, Duration)> {
        let (mut spans, mut end) = (Vec::new(), Duration::ZERO);
        for stage in &self.stages {
            spans.push((format!("before {}", stage.operator), stage.taken_in.saturating_sub(end)));
            let answered = stage.answered.unwrap_or(stage.taken_in);
            // Operators beside one another: what was counted is not counted again.
            let begin = stage.taken_in.max(end);
            spans.push((stage.operator.clone(), answered.saturating_sub(begin)));
            end = end.max(answered);
        }
        spans
    }

    /// Its age at the last answer.
    pub(super) fn age(&self) -> Duration {
        self.stages.iter().filter_map(|stage| stage.answered).max().unwrap_or_default()
    }
}

impl fmt::Display for FrameLife {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (stream, seq) = &self.frame;
        writeln!(f, "{stream} {seq}: {} old at its last answer", ms(self.age()))?;
        for FrameStage { operator, taken_in, answered, outcome, missing, more, calls } in
            &self.stages
        {
            let answered = answered.map_or_else(|| "?".to_owned(), ms);
            write!(f, "  {operator:20} {:>10} to {answered:>10}  {outcome}", ms(*taken_in))?;
            if *more > 0 {
                write!(f, ", and {more} more of this frame")?;
            }
            let without = if missing.is_empty() { "" } else { ", without " };
            writeln!(f, "{without}{}", missing.join(" "))?;
            for FrameCall { source, begun, ended, how, .. } in calls {
                let ended = ended.map_or_else(|| "?".to_owned(), ms);
                writeln!(f, "    {source:18} {:>10} to {ended:>10}  {how}", ms(*begun))?;
            }
        }
        let spans = self.spans();
        if let Some((what, most)) = spans.iter().max_by_key(|(_, span)| *span) {
            let share = 100.0 * most.as_secs_f64() / self.age().as_secs_f64().max(f64::EPSILON);
            writeln!(f, "  most went to: {what}, {} or {share:.0} %", ms(*most))?;
        }
        Ok(())
    }
}

impl fmt::Display for FrameOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open => f.write_str("not answered in the trace"),
            Self::By(source) => f.write_str(source),
            Self::Missed => f.write_str("missed: a substitute, or nothing, was sent"),
            Self::Refused(why) => write!(f, "refused {why}: a substitute, or nothing, was sent"),
        }
    }
}

impl<'a> MessageSearch<'a> {
    pub(super) fn new(
        seq: Option<u64>,
        stream: Option<&'a str>,
        header: &Header,
        file: &str,
    ) -> Self {
        let name = |cloud: &fuseline_traces::Cloud| {
            let name = cloud.name.clone().unwrap_or_else(|| format!("cloud-{}", cloud.p));
            (u64::from(cloud.p), name)
        };
        let clouds = header.clouds.iter().map(name);
        let names = clouds.chain([(0, "local".to_owned())]).collect();
        let operator = header.operator.clone().unwrap_or_else(|| file.to_owned());
        Self {
            seq,
            stream,
            operator,
            names,
            found: BTreeMap::new(),
            refused: Vec::new(),
            is_repeated: false,
            without_age: 0,
        }
    }

    pub(super) fn event(&mut self, event: &Event, annotations: &Annotations) {
        match event {
            Event::Input(Input::Open { at, t, .. }) => self.opened(*at, *t, annotations),
            Event::Input(Input::Result { at, t, p }) => self.ended(*at, *t, *p, "answered"),
            Event::Input(Input::Fail { at, t, p }) => self.ended(*at, *t, *p, "failed"),
            Event::Input(Input::Offer { .. } | Input::Tick { .. }) => {}
            Event::Decision(decision) => self.decided(decision),
        }
    }

    pub(super) fn finish(self) -> impl Iterator<Item = (FrameId, FrameStage)> {
        let found = self.found.into_values().map(|(frame, _, stage)| (frame, stage));
        found.chain(self.refused)
    }

    fn opened(&mut self, at: u64, t: u64, annotations: &Annotations) {
        self.is_repeated = self.found.contains_key(&t);
        if self.is_repeated {
            return;
        }
        let Some(Origin { stream, seq: Some(seq) }) = &annotations.origin else { return };
        let is_of_stream = self.stream.is_none_or(|wanted| wanted == &**stream);
        if self.seq.is_some_and(|wanted| wanted != *seq) || !is_of_stream {
            return;
        }
        let Some(age) = annotations.age else {
            self.without_age += 1;
            return;
        };
        let taken_in = Duration::from_nanos(age);
        let stage = FrameStage {
            operator: self.operator.clone(),
            taken_in,
            answered: None,
            outcome: FrameOutcome::Open,
            missing: annotations.missing.clone(),
            more: 0,
            calls: vec![FrameCall::new(0, self.name(0), taken_in)],
        };
        let captured = i128::from(at) - i128::from(age);
        self.found.insert(t, ((Arc::clone(stream), *seq), captured, stage));
    }

    fn decided(&mut self, decision: &Decision) {
        match decision {
            Decision::Request { at, t, p, .. } => {
                let cloud = self.name(*p);
                if let Some((_, captured, stage)) = self.found.get_mut(t) {
                    stage.calls.push(FrameCall::new(*p, cloud, since(*captured, *at)));
                }
            }
            Decision::Timer { at, t, p } => self.ended(*at, *t, *p, "late"),
            Decision::Cancel { at, t, p } => self.ended(*at, *t, *p, "not needed"),
            Decision::Emit { at, t, p } => {
                let by = FrameOutcome::By(self.name(*p));
                self.answered(*at, *t, by);
            }
            Decision::Miss { at, t } => self.answered(*at, *t, FrameOutcome::Missed),
            Decision::RefuseOpen { at, t, why } => {
                if self.is_repeated {
                    return;
                }
                self.answered(*at, *t, FrameOutcome::Refused(why.to_string()));
                if let Some((frame, _, mut stage)) = self.found.remove(t) {
                    stage.calls.clear();
                    self.refused.push((frame, stage));
                }
            }
            Decision::RefuseOffer { .. }
            | Decision::Hold { .. }
            | Decision::Drop { .. }
            | Decision::Final { .. } => {}
        }
    }

    /// A call ended; what comes of it later changes nothing.
    fn ended(&mut self, at: u64, t: u64, p: u64, how: &'static str) {
        let Some((_, captured, stage)) = self.found.get_mut(&t) else { return };
        let at = since(*captured, at);
        let mut open = stage.calls.iter_mut().filter(|call| call.ended.is_none());
        if let Some(call) = open.find(|call| call.p == p) {
            (call.ended, call.how) = (Some(at), how);
        }
    }

    fn answered(&mut self, at: u64, t: u64, outcome: FrameOutcome) {
        let Some((_, captured, stage)) = self.found.get_mut(&t) else { return };
        // Under progressive the last output is the best.
        (stage.answered, stage.outcome) = (Some(since(*captured, at)), outcome);
    }

    fn name(&self, p: u64) -> String {
        self.names.get(&p).cloned().unwrap_or_else(|| format!("cloud-{p}"))
    }
}

impl FrameCall {
    const fn new(p: u64, source: String, begun: Duration) -> Self {
        Self { p, source, begun, ended: None, how: "no answer in the trace" }
    }
}

fn since(captured: i128, at: u64) -> Duration {
    Duration::from_nanos(u64::try_from(i128::from(at) - captured).unwrap_or_default())
}

pub(super) fn ms(time: Duration) -> String {
    format!("{:.1} ms", time.as_secs_f64() * 1000.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(operator: &str, taken_in: u64, answered: u64) -> FrameStage {
        let of = Duration::from_millis;
        FrameStage {
            operator: operator.to_owned(),
            taken_in: of(taken_in),
            answered: Some(of(answered)),
            outcome: FrameOutcome::By("local".to_owned()),
            missing: Vec::new(),
            more: 0,
            calls: Vec::new(),
        }
    }

    #[test]
    fn what_two_operators_took_at_once_is_counted_once() {
        let stages =
            vec![stage("planner", 300, 350), stage("left", 10, 200), stage("right", 20, 250)];
        let life = FrameLife::new(("camera".into(), 7), stages);
        let spans: Vec<_> =
            life.spans().into_iter().map(|(what, it)| (what, it.as_millis())).collect();
        let expected = [
            ("before left", 10),
            ("left", 190),
            ("before right", 0),
            ("right", 50),
            ("before planner", 50),
            ("planner", 50),
        ];
        assert_eq!(spans, expected.map(|(what, ms)| (what.to_owned(), ms)));
        let whole: u128 = spans.iter().map(|(_, ms)| ms).sum();
        assert_eq!(whole, life.age().as_millis());
        assert!(life.to_string().ends_with("most went to: left, 190.0 ms or 54 %\n"), "{life}");
    }

    #[test]
    fn a_plan_that_control_uses_again_is_counted_and_a_dead_camera_is_named() {
        let mut stages = vec![stage("control", 100, 101), stage("planner", 40, 60)];
        stages.extend([stage("control", 50, 51), stage("control", 150, 151)]);
        stages[1].missing = vec!["left".into(), "place".into()];
        let life = FrameLife::new(("camera".into(), 7), stages);
        let lines = [
            "camera 7: 60.0 ms old at its last answer",
            "  planner                 40.0 ms to    60.0 ms  local, without left place",
            "  control                 50.0 ms to    51.0 ms  local, and 2 more of this frame",
            "  most went to: before planner, 40.0 ms or 67 %",
        ];
        assert_eq!(life.to_string(), lines.map(|line| format!("{line}\n")).concat());
    }
}
