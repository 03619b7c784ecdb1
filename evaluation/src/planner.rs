//! The planner of the paper's vehicle: it brakes once some consecutive frames report an obstacle.

/// The state of a timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum FrameStatus {
    /// Its output has not come.
    Unknown,
    /// It has no output.
    Missed,
    /// Its output reports no obstacle.
    Clear,
    /// Its output reports the obstacle.
    Obstacle,
}

/// Decides to brake once this many consecutive timestamps have outputs that all report the
/// obstacle. It counts timestamps, not arrivals (A12), and passes over timestamps without an
/// output.
///
/// T1 also demands that an output without a report does not break a row if local skips its frame.
/// That makes no difference here, because an obstacle that has come into sight stays in sight.
#[derive(Clone, Debug)]
pub(crate) struct Planner {
    wanted: usize,
    frames: Vec<FrameStatus>,
}

impl Planner {
    /// Returns a planner that needs this many timestamps.
    pub(crate) const fn new(wanted: usize) -> Self {
        Self { wanted, frames: Vec::new() }
    }

    /// Takes the status of timestamp `t`. Returns `true` if the planner now decides to brake.
    pub(crate) fn take(&mut self, t: usize, sight: FrameStatus) -> bool {
        if self.frames.len() <= t {
            self.frames.resize(t + 1, FrameStatus::Unknown);
        }
        self.frames[t] = sight;
        let (before, from) = self.frames.split_at(t);
        match sight {
            FrameStatus::Unknown | FrameStatus::Clear => false,
            FrameStatus::Missed | FrameStatus::Obstacle => {
                reports(before.iter().rev()) + reports(from.iter()) >= self.wanted
            }
        }
    }
}

/// Returns how many frames report before the first frame that is clear or unknown.
fn reports<'a>(sights: impl Iterator<Item = &'a FrameStatus>) -> usize {
    let row =
        sights.take_while(|sight| matches!(sight, FrameStatus::Missed | FrameStatus::Obstacle));
    row.filter(|sight| **sight == FrameStatus::Obstacle).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOME: FrameStatus = FrameStatus::Obstacle;

    fn decides(outputs: &[(usize, FrameStatus)]) -> Vec<bool> {
        let mut planner = Planner::new(3);
        outputs.iter().map(|(t, sight)| planner.take(*t, *sight)).collect()
    }

    #[test]
    fn it_decides_once_three_consecutive_timestamps_report_in_whatever_order_they_come() {
        assert_eq!(decides(&[(0, SOME), (2, SOME), (1, SOME)]), [false, false, true]);
        assert_eq!(decides(&[(0, SOME), (1, SOME), (3, SOME)]), [false; 3]);
    }

    #[test]
    fn a_late_output_of_an_older_timestamp_that_sees_nothing_takes_nothing_back() {
        let outputs = [(1, SOME), (2, SOME), (0, FrameStatus::Clear), (3, SOME)];
        assert_eq!(decides(&outputs), [false, false, false, true]);
        let between = [(0, SOME), (1, FrameStatus::Clear), (2, SOME), (3, SOME), (4, SOME)];
        assert_eq!(decides(&between), [false, false, false, false, true]);
    }

    #[test]
    fn timestamps_without_output_are_passed_over_once_that_is_known() {
        let outputs = [(0, SOME), (2, SOME), (3, SOME), (1, FrameStatus::Missed)];
        assert_eq!(decides(&outputs), [false, false, false, true]);
        let early =
            [(0, FrameStatus::Missed), (1, SOME), (2, FrameStatus::Missed), (3, SOME), (4, SOME)];
        assert_eq!(decides(&early), [false, false, false, false, true]);
    }
}
