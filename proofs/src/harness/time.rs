//! Instants and deadlines over their whole range.

use crate::arbitrary::{any_deadline, any_instant};
use crate::time::{Deadline, Instant};

/// A due instant is exact if it fits, and otherwise the last instant. Nothing wraps or panics (A14, F2).
///
/// Bounds: none.
#[kani::proof]
#[kani::unwind(20)]
pub fn a14_due_saturates() {
    let (now, deadline) = (any_instant(), any_deadline());
    let due = now.saturating_add(deadline);
    let exact = u128::from(now.as_nanos()) + u128::from(deadline.as_nanos());
    let fits = exact <= u128::from(u64::MAX);
    kani::assert(!fits || u128::from(due.as_nanos()) == exact, "A14: it is exact where it fits");
    kani::assert(fits || due == Instant::END, "A14: it is the last instant where it does not");
    kani::assert(due >= now, "A14: it is never before now");
    let is_zero = deadline.as_nanos() == 0;
    let is_past = due <= now;
    kani::assert(
        is_past == (is_zero || now == Instant::END),
        "A11: it is past for no other reason",
    );
    kani::cover!(!fits, "it saturates");
    kani::cover!(due == Instant::END && fits, "it just fits");
    kani::cover!(is_past && !is_zero, "the clock is at its end");
}

/// A deadline in milliseconds saturates exactly if it does not fit (A14).
///
/// Bounds: none.
#[kani::proof]
#[kani::unwind(20)]
pub fn a14_deadline_saturates() {
    // 2⁶⁴ − 1 ns are 18,446,744,073,709 whole milliseconds, the greatest number whose product fits.
    const FITTING: u64 = 18_446_744_073_709;
    let millis: u64 = if kani::any() { FITTING } else { kani::any() };
    let deadline = Deadline::from_millis(millis);
    let is_longest = deadline.as_nanos() == u64::MAX;
    kani::assert(is_longest == (millis > FITTING), "A14: it saturates exactly beyond what fits");
    let is_exact = is_longest || deadline.as_nanos() >= millis;
    kani::assert(is_exact, "A14: it is never shorter than its number");
    kani::cover!(millis == FITTING, "the longest that fits");
    kani::cover!(is_longest, "it saturates");
}
