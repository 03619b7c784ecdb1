//! A vehicle before an obstacle at rest, frame by frame: written from the rules of fusion and of braking alone.
//!
//! It shares no formula with the guard: it knows no budgets, only frames, arrivals and a braking distance.

/// What is true of one drive towards one obstacle, in metres and seconds.
#[derive(Clone, Debug)]
pub(crate) struct Drive {
    pub(crate) speed: f64,
    pub(crate) deceleration: f64,
    pub(crate) brake_delay: f64,
    /// Frames in a row that must report.
    pub(crate) reports: u32,
    pub(crate) range_local: f64,
    pub(crate) range_cloud: f64,
    /// The obstacle is hidden while it is further away.
    pub(crate) hidden_beyond: f64,
    pub(crate) frames: Vec<Frame>,
}

/// One frame, with what would come of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) captured: f64,
    /// Distance to the obstacle.
    pub(crate) gap: f64,
    /// How long local takes; none if it skips the frame, being busy.
    pub(crate) local: Option<f64>,
    /// How long the cloud's result takes; infinite if none comes.
    pub(crate) cloud: f64,
    /// How late this frame's timer is.
    pub(crate) lateness: f64,
}

/// An output for one timestamp.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Output {
    pub(crate) at: f64,
    /// Whether it reports the obstacle; none if there is no output, which is known at that instant.
    pub(crate) reports: Option<bool>,
}

impl Drive {
    fn sees(&self, range: f64, frame: &Frame) -> bool {
        frame.gap <= range && frame.gap <= self.hidden_beyond
    }

    /// The outputs of local alone.
    pub(crate) fn local_alone(&self) -> Vec<Output> {
        let output = |frame: &Frame| {
            let at = frame.captured + frame.local.unwrap_or(0.0);
            Output { at, reports: frame.local.map(|_| self.sees(self.range_local, frame)) }
        };
        self.frames.iter().map(output).collect()
    }

    /// The outputs of fusion, with this deadline for each frame.
    pub(crate) fn fused(&self, deadline: impl Fn(&Frame) -> f64) -> Vec<Output> {
        let output = |frame: &Frame| {
            let deadline = deadline(frame);
            if frame.cloud < deadline {
                let reports = self.sees(self.range_cloud, frame);
                return Output { at: frame.captured + frame.cloud, reports: Some(reports) };
            }
            // Local's result is an input: by its arrival every timer that was due has fired, however late timers are.
            let wait = match frame.local {
                Some(local) if local >= deadline => local,
                _ => deadline + frame.lateness,
            };
            let reports = frame.local.map(|_| self.sees(self.range_local, frame));
            Output { at: frame.captured + wait, reports }
        };
        self.frames.iter().map(output).collect()
    }

    /// Whether the vehicle hits the obstacle: it brakes once enough timestamps in a row report; those without output are
    /// passed over when that is known.
    pub(crate) fn collides(&self, outputs: &[Output]) -> bool {
        let mut decided = f64::INFINITY;
        for first in 0..outputs.len() {
            let (mut reports, mut at) = (0, 0.0_f64);
            for output in &outputs[first..] {
                at = at.max(output.at);
                match output.reports {
                    Some(true) => reports += 1,
                    Some(false) => break,
                    None => {}
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
