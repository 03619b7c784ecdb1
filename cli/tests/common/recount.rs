//! A recount of the messages and calls of a drawn trace, with plain lists.

use fuseline_traces::{Annotations, Commit, Decision, Event, Input, ValueKeys};

use super::drawn::DrawnTrace;

/// Local's computation or a request, from its begin to its end.
#[derive(Debug)]
pub(crate) struct RecountedCall {
    pub(crate) t: u64,
    pub(crate) p: u64,
    pub(crate) begun: u64,
    pub(crate) due: Option<u64>,
    pub(crate) end: Option<(u64, RecountedEnd)>,
    /// The annotations of the line that began it.
    pub(crate) annotations: Annotations,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum RecountedEnd {
    Result(ValueKeys),
    Failure,
    Timer,
    Cancelled,
    Refused,
    /// Its message ended before it.
    Retired,
}

/// An accepted message.
pub(crate) struct RecountedSpan {
    pub(crate) t: u64,
    pub(crate) opened: u64,
    pub(crate) deadline: Option<u64>,
    pub(crate) annotations: Annotations,
    /// The source whose result was sent last.
    pub(crate) by: Option<u64>,
    /// When, if the message goes on.
    pub(crate) sent: Option<u64>,
    /// When, and what the output says of its value.
    pub(crate) end: Option<(u64, ValueKeys)>,
}

impl DrawnTrace {
    pub(crate) fn is_progressive(&self) -> bool {
        self.header.commit == Commit::Progressive
    }

    /// Returns whether the decisions about the input at this index refuse an open.
    pub(crate) fn is_refused(&self, index: usize) -> bool {
        let own = self.events[index + 1..].iter().map(|(event, _)| event);
        own.take_while(|event| matches!(event, Event::Decision(_)))
            .any(|event| matches!(event, Event::Decision(Decision::RefuseOpen { .. })))
    }

    /// The messages, and the calls in the order of their begins. Of a timestamp that is open
    /// another open is none. `retires` says of a source whether its calls end with an output of
    /// another, or with their message.
    pub(crate) fn recount(
        &self,
        retires: impl Fn(u64, Option<u64>) -> bool,
    ) -> (Vec<RecountedSpan>, Vec<RecountedCall>) {
        let (mut messages, mut calls) = (Vec::<RecountedSpan>::new(), Vec::new());
        let mut call = |index, (t, p), begun, due| {
            let end = self.end_of((t, p), index, &retires);
            let annotations = self.events[index].1.clone();
            calls.push(RecountedCall { t, p, begun, due, end, annotations });
        };
        for (index, (event, annotations)) in self.events.iter().enumerate() {
            match *event {
                Event::Input(Input::Open { at, t, deadline })
                    if open(&mut messages, t).is_none() =>
                {
                    call(index, (t, 0), at, deadline.map(|deadline| at.saturating_add(deadline)));
                    if !self.is_refused(index) {
                        let annotations = annotations.clone();
                        let (by, sent, end, opened) = (None, None, None, at);
                        messages.push(RecountedSpan {
                            t,
                            opened,
                            deadline,
                            annotations,
                            by,
                            sent,
                            end,
                        });
                    }
                }
                Event::Decision(Decision::Request { at, t, p, due }) => {
                    call(index, (t, p), at, Some(due));
                }
                Event::Decision(Decision::Emit { at, t, p }) => {
                    let message = open(&mut messages, t).unwrap();
                    message.by = Some(p);
                    if self.is_progressive() {
                        message.sent = Some(at);
                    } else {
                        message.end = Some((at, annotations.value()));
                    }
                }
                Event::Decision(Decision::Final { at, t, .. } | Decision::Miss { at, t }) => {
                    open(&mut messages, t).unwrap().end = Some((at, ValueKeys::default()));
                }
                _ => {}
            }
        }
        (messages, calls)
    }

    /// Returns what first ends the call that the line at this index begins.
    fn end_of(
        &self,
        of: (u64, u64),
        begin: usize,
        retires: impl Fn(u64, Option<u64>) -> bool,
    ) -> Option<(u64, RecountedEnd)> {
        let is_refused = of.1 == 0 && self.is_refused(begin);
        self.events[begin + 1..].iter().find_map(|(event, annotations)| match *event {
            Event::Input(Input::Result { at, t, p }) if (t, p) == of => {
                Some((at, RecountedEnd::Result(annotations.value())))
            }
            Event::Input(Input::Fail { at, t, p }) if (t, p) == of => {
                Some((at, RecountedEnd::Failure))
            }
            Event::Input(_) => None,
            Event::Decision(decision) => match decision {
                Decision::Timer { at, t, p } if (t, p) == of => Some((at, RecountedEnd::Timer)),
                Decision::Cancel { at, t, p } if (t, p) == of => {
                    Some((at, RecountedEnd::Cancelled))
                }
                Decision::RefuseOpen { at, t, .. } if is_refused && t == of.0 => {
                    Some((at, RecountedEnd::Refused))
                }
                Decision::Emit { at, t, p } if t == of.0 => {
                    retires(of.1, Some(p)).then_some((at, RecountedEnd::Retired))
                }
                Decision::Final { at, t, .. } | Decision::Miss { at, t } if t == of.0 => {
                    retires(of.1, None).then_some((at, RecountedEnd::Retired))
                }
                _ => None,
            },
        })
    }

    /// Returns what a source is called; `unnamed` stands before the priority of a cloud without a
    /// name.
    pub(crate) fn name(&self, p: u64, unnamed: &str) -> String {
        let cloud = self.header.clouds.iter().find(|cloud| u64::from(cloud.p) == p);
        match cloud {
            Some(cloud) => cloud.name.clone().unwrap_or_else(|| format!("{unnamed}{p}")),
            None if p == 0 => "local".to_owned(),
            None => "not registered".to_owned(),
        }
    }
}

/// The message of this timestamp that has not ended.
fn open(messages: &mut [RecountedSpan], t: u64) -> Option<&mut RecountedSpan> {
    messages.iter_mut().find(|message| message.t == t && message.end.is_none())
}
