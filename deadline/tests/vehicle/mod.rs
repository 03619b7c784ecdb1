//! A vehicle before an obstacle at rest, frame by frame, written only from the rules of fusion and
//! of braking.
//!
//! It shares no formula with the guard: it knows no budgets, only frames, arrivals and a braking
//! distance.

/// The truth about one drive towards one obstacle, in metres and seconds.
#[derive(Clone, Debug)]
pub(crate) struct Drive {
    pub(crate) speed: f64,
    pub(crate) deceleration: f64,
    pub(crate) brake_delay: f64,
    /// The number of frames in a row that must report.
    pub(crate) reports: u32,
    pub(crate) range_local: f64,
    pub(crate) range_cloud: f64,
    /// The obstacle is hidden while it is further away than this.
    pub(crate) hidden_beyond: f64,
    pub(crate) frames: Vec<Frame>,
}

/// One frame, and when its results come.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) captured: f64,
    /// The distance to the obstacle.
    pub(crate) gap: f64,
    /// The time that local takes, or `None` if local is busy and skips the frame.
    pub(crate) local: Option<f64>,
    /// The time that the cloud's result takes, which is infinite if none comes.
    pub(crate) cloud: f64,
    /// The delay of this frame's timer.
    pub(crate) lateness: f64,
    /// `true` if something passes in front of the obstacle, so that no source sees it.
    pub(crate) is_covered: bool,
}

/// An output for one timestamp.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Output {
    pub(crate) at: f64,
    /// `true` if the output reports the obstacle; `None` if it becomes known at that instant that
    /// there is no output.
    pub(crate) reports: Option<bool>,
    /// `true` if local takes the frame.
    pub(crate) is_taken: bool,
}

impl Drive {
    fn sees(&self, range: f64, frame: &Frame) -> bool {
        frame.gap <= range && frame.gap <= self.hidden_beyond && !frame.is_covered
    }

    /// Returns the outputs of local alone.
    pub(crate) fn local_alone(&self) -> Vec<Output> {
        let output = |frame: &Frame| {
            let at = frame.captured + frame.local.unwrap_or(0.0);
            let reports = frame.local.map(|_| self.sees(self.range_local, frame));
            Output { at, reports, is_taken: frame.local.is_some() }
        };
        self.frames.iter().map(output).collect()
    }

    /// Returns the outputs of fusion, with this deadline for each frame.
    pub(crate) fn fused(&self, deadline: impl Fn(&Frame) -> f64) -> Vec<Output> {
        let output = |frame: &Frame| {
            let (deadline, is_taken) = (deadline(frame), frame.local.is_some());
            if frame.cloud < deadline {
                let reports = Some(self.sees(self.range_cloud, frame));
                return Output { at: frame.captured + frame.cloud, reports, is_taken };
            }
            // Local's result is an input, so every timer that was due by its arrival has fired,
            // however late timers are.
            let wait = match frame.local {
                Some(local) if local >= deadline => local,
                _ => deadline + frame.lateness,
            };
            let reports = frame.local.map(|_| self.sees(self.range_local, frame));
            Output { at: frame.captured + wait, reports, is_taken }
        };
        self.frames.iter().map(output).collect()
    }

    /// Returns `true` if the vehicle hits the obstacle. It brakes once enough timestamps in a row
    /// report.
    ///
    /// A timestamp without output is passed over when that is known. So is an output without a
    /// report for a frame that local does not take.
    pub(crate) fn collides(&self, outputs: &[Output]) -> bool {
        self.collides_where(outputs, |output| output.is_taken)
    }

    /// Does the same, but any output without a report breaks a row, even if local does not take its
    /// frame.
    pub(crate) fn collides_where_any_output_counts(&self, outputs: &[Output]) -> bool {
        self.collides_where(outputs, |_| true)
    }

    /// Returns `true` if the vehicle hits the obstacle, where the outputs without a report that
    /// `breaks` selects break a row.
    fn collides_where(&self, outputs: &[Output], breaks: impl Fn(&Output) -> bool) -> bool {
        let mut decided = f64::INFINITY;
        for first in 0..outputs.len() {
            let (mut reports, mut at) = (0, 0.0_f64);
            for output in &outputs[first..] {
                at = at.max(output.at);
                match output.reports {
                    Some(true) => reports += 1,
                    Some(false) if breaks(output) => break,
                    Some(false) | None => {}
                }
                if reports == self.reports {
                    decided = decided.min(at);
                    break;
                }
            }
        }
        let start = self.frames[0].gap;
        let at_braking = start - self.speed * (decided + self.brake_delay);
        at_braking <= self.speed * self.speed / (2.0 * self.deceleration)
    }
}
