//! What is known of one frame: when each operator took it in, who answered, and what lies between.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use fuseline_traces::{Annotations, Decision, Event, Header, Input};

/// One operator's message of the frame. Times are since the capture.
#[derive(Clone, Debug)]
pub(super) struct FrameStage {
    pub(super) stream: String,
    pub(super) operator: String,
    pub(super) taken_in: Duration,
    /// None if the trace ends before.
    pub(super) answered: Option<Duration>,
    /// By whom, or that nobody did.
    pub(super) by: String,
    /// The calls, by cloud: from the request on, and how each ended.
    pub(super) calls: Vec<FrameCall>,
}

/// One cloud's part in a message.
#[derive(Clone, Debug)]
pub(super) struct FrameCall {
    pub(super) cloud: String,
    pub(super) requested: Duration,
    pub(super) ended: Option<Duration>,
    pub(super) how: &'static str,
}

/// A frame through all operators, in the order in which they took it in.
pub(super) struct FrameLife {
    pub(super) stream: String,
    pub(super) seq: u64,
    pub(super) stages: Vec<FrameStage>,
}

/// Looks for a frame's messages in one trace.
pub(super) struct MessageSearch<'a> {
    seq: u64,
    stream: Option<&'a str>,
    operator: String,
    names: BTreeMap<u64, String>,
    /// By timestamp, with when the frame was captured by the trace's clock.
    found: BTreeMap<u64, (i128, FrameStage)>,
    /// Messages whose ages are unknown.
    pub(super) without_age: u64,
}

impl FrameLife {
    pub(super) fn new(stream: String, seq: u64, mut stages: Vec<FrameStage>) -> Self {
        stages.sort_by_key(|stage| (stage.taken_in, stage.answered));
        Self { stream, seq, stages }
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
        writeln!(f, "{} {}: {} old at its last answer", self.stream, self.seq, ms(self.age()))?;
        for FrameStage { operator, taken_in, answered, by, calls, .. } in &self.stages {
            let answered = answered.map_or_else(|| "?".to_owned(), ms);
            writeln!(f, "  {operator:16} {:>10} to {answered:>10}  {by}", ms(*taken_in))?;
            for FrameCall { cloud, requested, ended, how } in calls {
                let ended = ended.map_or_else(|| "?".to_owned(), ms);
                writeln!(f, "    {cloud:14} {:>10} to {ended:>10}  {how}", ms(*requested))?;
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

impl<'a> MessageSearch<'a> {
    pub(super) fn new(seq: u64, stream: Option<&'a str>, header: &Header, file: &str) -> Self {
        let name = |cloud: &fuseline_traces::Cloud| {
            let name = cloud.name.clone().unwrap_or_else(|| format!("cloud-{}", cloud.p));
            (u64::from(cloud.p), name)
        };
        let clouds = header.clouds.iter().map(name);
        let names = clouds.chain([(0, "local".to_owned())]).collect();
        let operator = header.operator.clone().unwrap_or_else(|| file.to_owned());
        Self { seq, stream, operator, names, found: BTreeMap::new(), without_age: 0 }
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

    pub(super) fn finish(self) -> Vec<FrameStage> {
        self.found.into_values().map(|(_, stage)| stage).collect()
    }

    fn opened(&mut self, at: u64, t: u64, annotations: &Annotations) {
        let Some(origin) = &annotations.origin else { return };
        let is_of_stream = self.stream.is_none_or(|stream| stream == &*origin.stream);
        if origin.seq != Some(self.seq) || !is_of_stream {
            return;
        }
        let Some(age) = annotations.age else {
            self.without_age += 1;
            return;
        };
        let stage = FrameStage {
            stream: origin.stream.to_string(),
            operator: self.operator.clone(),
            taken_in: Duration::from_nanos(age),
            answered: None,
            by: "not answered in the trace".to_owned(),
            calls: Vec::new(),
        };
        self.found.entry(t).or_insert((i128::from(at) - i128::from(age), stage));
    }

    fn decided(&mut self, decision: &Decision) {
        match decision {
            Decision::Request { at, t, p, .. } => {
                let cloud = self.name(*p);
                if let Some((captured, stage)) = self.found.get_mut(t) {
                    let (requested, how) = (since(*captured, *at), "no answer in the trace");
                    stage.calls.push(FrameCall { cloud, requested, ended: None, how });
                }
            }
            Decision::Timer { at, t, p } => self.ended(*at, *t, *p, "late"),
            Decision::Cancel { at, t, p } => self.ended(*at, *t, *p, "not needed"),
            Decision::Emit { at, t, p } => {
                let by = self.name(*p);
                self.answered(*at, *t, by);
            }
            Decision::Miss { at, t } => self.answered(*at, *t, "missed".to_owned()),
            Decision::RefuseOpen { at, t, why } => {
                self.answered(*at, *t, format!("refused: {why}"));
            }
            Decision::RefuseOffer { .. }
            | Decision::Hold { .. }
            | Decision::Drop { .. }
            | Decision::Final { .. } => {}
        }
    }

    /// A call ended; what comes of it later changes nothing.
    fn ended(&mut self, at: u64, t: u64, p: u64, how: &'static str) {
        let cloud = self.name(p);
        let Some((captured, stage)) = self.found.get_mut(&t) else { return };
        let at = since(*captured, at);
        let mut open = stage.calls.iter_mut().filter(|call| call.ended.is_none());
        if let Some(call) = open.find(|call| call.cloud == cloud) {
            (call.ended, call.how) = (Some(at), how);
        }
    }

    fn answered(&mut self, at: u64, t: u64, by: String) {
        let Some((captured, stage)) = self.found.get_mut(&t) else { return };
        // Under progressive the last output is the best.
        (stage.answered, stage.by) = (Some(since(*captured, at)), by);
    }

    fn name(&self, p: u64) -> String {
        self.names.get(&p).cloned().unwrap_or_else(|| format!("cloud-{p}"))
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
            stream: "camera".to_owned(),
            operator: operator.to_owned(),
            taken_in: of(taken_in),
            answered: Some(of(answered)),
            by: "local".to_owned(),
            calls: Vec::new(),
        }
    }

    #[test]
    fn what_two_operators_took_at_once_is_counted_once() {
        let stages =
            vec![stage("planner", 300, 350), stage("left", 10, 200), stage("right", 20, 250)];
        let life = FrameLife::new("camera".to_owned(), 7, stages);
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
}
