//! Notices the first message for which an operator under eager gives away a better cloud's chance
//! (A4).

use fuseline_traces::Commit;

/// The requests admitted for one message, until the first warning.
pub(crate) struct EagerNotice {
    is_over: bool,
    t: Option<u64>,
    /// The priorities and due instants.
    admitted: Vec<(u16, u64)>,
}

impl EagerNotice {
    /// Creates a notice. It is already over under other rules, because only eager commits by a
    /// lower cloud's timer.
    pub(crate) const fn new(commit: Commit) -> Self {
        let is_over = !matches!(commit, Commit::Eager);
        Self { is_over, t: None, admitted: Vec::new() }
    }

    /// Notes a request. Returns the lower and the better cloud the first time that the lower one's
    /// timer is earlier.
    pub(crate) fn admitted(&mut self, t: u64, p: u16, due: u64) -> Option<(u16, u16)> {
        if self.is_over {
            return None;
        }
        if self.t != Some(t) {
            self.t = Some(t);
            self.admitted.clear();
        }
        let found = self.admitted.iter().find_map(|&(other, other_due)| {
            let (low, high) = if other < p {
                ((other, other_due), (p, due))
            } else {
                ((p, due), (other, other_due))
            };
            (low.1 < high.1).then_some((low.0, high.0))
        });
        self.admitted.push((p, due));
        self.is_over = found.is_some();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notices_a_lower_clouds_earlier_timer_once() {
        let mut notice = EagerNotice::new(Commit::Eager);
        let mut admitted = |t, p, due| notice.admitted(t, p, due);
        assert_eq!([admitted(0, 1, 100), admitted(0, 2, 100), admitted(0, 3, 90)], [None; 3]);
        assert_eq!([admitted(1, 3, 200), admitted(2, 1, 150)], [None; 2], "of two messages");
        assert_eq!(admitted(2, 3, 151), Some((1, 3)));
        assert_eq!([admitted(3, 1, 1), admitted(3, 2, 2)], [None; 2], "it was reported");
        let mut patient = EagerNotice::new(Commit::Patient);
        assert_eq!([patient.admitted(0, 1, 1), patient.admitted(0, 2, 2)], [None; 2]);
    }
}
