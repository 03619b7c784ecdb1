//! The plain data of the interface. `include/fuseline.h` is generated from this file, and a test
//! compares them.
#![expect(clippy::doc_markdown, reason = "these texts are the header's, which has no markdown")]

/// The version of this interface. A library refuses a header of another version.
pub const FUSELINE_ABI: u32 = 2;
/// The greatest number of sources of a machine: local and 15 clouds.
pub const FUSELINE_SOURCES: usize = 16;
/// The bytes of a machine's storage that do not depend on its capacity.
pub const FUSELINE_BYTES: usize = 256;
/// The bytes of a machine's storage for each cloud.
pub const FUSELINE_BYTES_A_CLOUD: usize = 64;
/// The bytes of a machine's storage for each timestamp of the window.
pub const FUSELINE_BYTES_A_TIMESTAMP: usize = 96;
/// The bytes of a machine's storage for each timestamp and cloud.
pub const FUSELINE_BYTES_A_TIMER: usize = 8;

/// The bytes of the storage of a machine for many threads that do not depend on its capacity.
pub const FUSELINE_SHARED_BYTES: usize = 256;
/// The bytes of the storage of a machine for many threads for each cloud.
pub const FUSELINE_SHARED_BYTES_A_CLOUD: usize = 128;

/// The status of a call. From FUSELINE_STATUS_NULL on, the call was wrong and changed nothing.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CStatus {
    /// The input was applied, and the answer is its own.
    Done = 0,
    /// Timers fired first (F5). The answer is theirs, and the input was not applied. Act on the
    /// answer, then make the same call again.
    Again = 1,
    /// There is nothing to report: no timer is armed, the timestamp is not open, or no cloud has
    /// this priority.
    None = 2,
    /// A pointer is null.
    Null = 16,
    /// A pointer is not aligned for its type.
    Alignment = 17,
    /// The storage is too small for the capacity.
    Size = 18,
    /// An answer would be in the machine's storage, or two answers of one call would share bytes.
    Overlap = 19,
    /// There is no machine: it was never initialised, was ended, was copied from elsewhere, or was
    /// overwritten.
    Foreign = 20,
    /// This call interrupted another call to this machine, which is under way.
    Busy = 21,
    /// The header has another version than the library.
    Abi = 22,
    /// The library was not built for exactly this number of clouds and this window.
    Capacity = 23,
    /// There is no such commit rule.
    Commit = 24,
    /// The window is 0 or exceeds the capacity.
    Window = 25,
    /// The number of clouds exceeds the capacity.
    Clouds = 26,
    /// A cloud's priority is not from 1 to 65535.
    Priority = 27,
    /// Two clouds have the same priority (A10).
    Twice = 28,
    /// A cloud's gate does not resume below its limit (F2g).
    Gate = 29,
    /// The greatest deadline is 0, so every deadline would be refused.
    Deadline = 30,
    /// The message id is not of this machine: another machine gave it, or none did.
    MessageId = 31,
}

/// The capacity of a machine: 65536 times the number of clouds, plus the number of open timestamps
/// (FUSELINE_CAPACITY_OF). A library may be built for one more capacity, with FUSELINE_OWN_CLOUDS
/// and FUSELINE_OWN_WINDOW; see fuseline_own_capacity.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CCapacity {
    /// 1 cloud and a window of 4.
    C1W4 = 0x1_0004,
    /// 3 clouds and a window of 16.
    C3W16 = 0x3_0010,
    /// 7 clouds and a window of 64.
    C7W64 = 0x7_0040,
    /// 15 clouds and a window of 1024, which is everything that SPEC.md allows.
    C15W1024 = 0xf_0400,
}

/// Returns the number of a capacity, as the header's FUSELINE_CAPACITY_OF.
#[expect(clippy::cast_possible_truncation, reason = "at most 15 clouds and a window of 1024")]
pub(crate) const fn capacity_of(clouds: usize, window: usize) -> u32 {
    (clouds as u32) << 16 | window as u32
}
const _: () = {
    assert!(CCapacity::C1W4 as u32 == capacity_of(1, 4), "its name says it");
    assert!(CCapacity::C3W16 as u32 == capacity_of(3, 16), "its name says it");
    assert!(CCapacity::C7W64 as u32 == capacity_of(7, 64), "its name says it");
    assert!(CCapacity::C15W1024 as u32 == capacity_of(15, 1024), "its name says it");
};

/// Decides when a result is forwarded although a better one is pending (F6, F9).
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CCommit {
    /// Forwards the best available result as soon as any cloud's timer fires.
    Eager = 0,
    /// Forwards the best available result once nothing pending outranks it.
    Patient = 1,
    /// Sends each result that is better than those before it at once: FUSELINE_OUTCOME_PRELIMINARY
    /// while better ones may follow.
    Progressive = 2,
}

/// The outcome of an input, or of timers that fired.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum COutcome {
    /// Tick: time passed.
    Nothing = 0,
    /// Open: the timestamp is open and waits for local.
    Accepted = 1,
    /// Open, offer: refused for the reason `why`. Nothing changed except, possibly, a gate. A
    /// refused request must not be sent.
    Refused = 2,
    /// Offer: send the request. Its result is in time if it arrives before `due`.
    Admitted = 3,
    /// Result: keep its value, because a source that outranks it is pending.
    Held = 4,
    /// Send the value of `by` downstream. The timestamp is retired: discard its other held values.
    /// The calls of `cancelled` may be aborted.
    Forwarded = 5,
    /// Result, failure: dropped for the reason `why`. Nothing changed. Discard its value.
    Dropped = 6,
    /// The timestamp is retired: no result arrived in time and none is pending.
    Missed = 7,
    /// Failure, timers: the timestamp stays open.
    Waiting = 8,
    /// Result, progressive only: send the value of `by` downstream. The calls of `cancelled` may be
    /// aborted. The timestamp stays open for better values, until FUSELINE_OUTCOME_FORWARDED or
    /// FUSELINE_OUTCOME_FINAL comes.
    Preliminary = 9,
    /// Failure, timers, progressive only: the value of `by`, sent before, was the last one. The
    /// timestamp is retired, and there is nothing to send.
    Final = 10,
}

/// The reason why an input was refused or dropped: the first one that holds, in the order of
/// SPEC.md.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CReason {
    /// The input was neither refused nor dropped.
    None = 0,
    /// Open: this timestamp or a later one was opened before.
    Order = 1,
    /// Open: the number of open timestamps has reached the window.
    Full = 2,
    /// Open, offer: the due instant is not later than now, or the deadline is above the
    /// configuration's greatest.
    Deadline = 3,
    /// No source has this priority, or neither this timestamp nor a later one was ever opened.
    Unknown = 4,
    /// Offer: the timestamp is not open.
    Closed = 5,
    /// The cloud was requested before; or the source's result is already held or, under
    /// progressive, was sent last.
    Duplicate = 6,
    /// Offer: a held result or, under progressive, the last one sent outranks whatever this cloud
    /// would return.
    Outranked = 7,
    /// Offer: the cloud's gate is shut.
    Queue = 8,
    /// Result, failure: the timestamp is not open or, under progressive, the last result sent
    /// outranks the source's.
    Superseded = 9,
    /// Result, failure: the source was not requested for this timestamp.
    Unsolicited = 10,
    /// Result, failure: the request was closed by its timer or by a failure.
    Late = 11,
}

/// Configures one cloud.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CCloud {
    /// The cloud's rank, from 1 to 65535, different for each cloud. The greater number wins.
    pub priority: u64,
    /// The number of queued requests, at least 1, at which the gate shuts.
    pub limit: u64,
    /// The number of queued requests, less than `limit`, at or below which a shut gate opens.
    pub resume: u64,
}

/// Configures a machine. FUSELINE_CONFIG gives the first two members.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CConfig {
    /// Must be FUSELINE_ABI.
    pub abi: u32,
    /// Must be FUSELINE_LAYOUT.
    pub layout: u32,
    /// The capacity: a fuseline_capacity, or a value of FUSELINE_CAPACITY_OF.
    pub capacity: u32,
    /// The commit rule: a fuseline_commit.
    pub commit: u32,
    /// The greatest number of timestamps that may be open at once, from 1 to the capacity's.
    pub window: u32,
    /// The number of clouds, from 0 to the capacity's.
    pub clouds_len: u32,
    /// The clouds in any order. The pointer may be null if there are none, and is not used after
    /// the call.
    pub clouds: *const CCloud,
    /// The greatest deadline in nanoseconds, at least 1: the longest time that the system may wait
    /// for a message. A longer deadline is refused as FUSELINE_REASON_DEADLINE. So is a negative
    /// number, because it is huge without its sign.
    pub greatest_deadline: u64,
}

/// The decision of a call. It is complete: nothing else happened.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CAnswer {
    /// The machine's clock at the decision, in nanoseconds (F0).
    pub at: u64,
    /// The timestamp; 0 for a tick.
    pub t: u64,
    /// The due instant of the timers that fired or of an admitted request; otherwise 0.
    pub due: u64,
    /// The outcome of the input or of the timers.
    pub outcome: COutcome,
    /// The reason why the input was refused or dropped.
    pub why: CReason,
    /// Forwarded, preliminary, final: the source of the result; 0 is local. Otherwise 0.
    pub by: u32,
    /// 1 if timers fired (FUSELINE_STATUS_AGAIN), otherwise 0.
    pub fired: u32,
    /// The number of valid entries of `timers`; the others are 0.
    pub timers_len: u32,
    /// The number of valid entries of `cancelled`; the others are 0.
    pub cancelled_len: u32,
    /// The priorities whose timers fired, ascending; 0 is local.
    pub timers: [u16; FUSELINE_SOURCES],
    /// Forwarded, preliminary: the clouds whose results are no longer wanted, ascending.
    pub cancelled: [u16; FUSELINE_SOURCES],
}

/// The state of a machine as a whole.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CState {
    /// The greatest instant seen, in nanoseconds.
    pub now: u64,
    /// The greatest timestamp ever opened. It is valid if `has_newest` is 1.
    pub newest: u64,
    /// The next due instant. It is valid if `has_due` is 1.
    pub due: u64,
    /// 1 if a timestamp was ever opened, otherwise 0.
    pub has_newest: u32,
    /// 1 if a timer is armed, otherwise 0.
    pub has_due: u32,
    /// The number of open timestamps.
    pub open_len: u32,
    /// The greatest number of open timestamps.
    pub window: u32,
}

/// The state of an open timestamp, as sets of sources with one bit each. Bit `i` is the source
/// `priorities[i]`.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CMessage {
    /// The due instant of each source's timer. It is valid if the source is in `armed`.
    pub dues: [u64; FUSELINE_SOURCES],
    /// The sources' priorities, ascending. The first is local's, 0.
    pub priorities: [u16; FUSELINE_SOURCES],
    /// The number of sources: local and the clouds.
    pub sources_len: u32,
    /// The sources that were requested.
    pub requested: u32,
    /// The requested sources for which no result, failure or timer has come.
    pub pending: u32,
    /// The sources whose timer is live.
    pub armed: u32,
    /// The sources whose result is held; under progressive, the source of the last output.
    pub cached: u32,
    /// Always 0.
    pub reserved: u32,
}

/// Identifies one open message of the machine for many threads that opened it. Another machine
/// refuses it with FUSELINE_STATUS_MESSAGE_ID, and every machine refuses an id that is all 0.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CMessageId {
    /// Opaque: do not read or change it.
    pub opaque: [u64; 3],
}

/// The header's FUSELINE_LAYOUT for the library's compiler: the sizes of the interface's
/// structures.
pub(crate) const LAYOUT: u32 = {
    let sizes = [
        size_of::<CConfig>(),
        size_of::<CCloud>(),
        size_of::<CAnswer>(),
        size_of::<CState>() ^ size_of::<CMessage>(),
    ];
    let [config, cloud, answer, questions] = sizes;
    assert!(config < 256 && cloud < 256 && answer < 256 && questions < 256, "a byte holds each");
    #[expect(clippy::cast_possible_truncation, reason = "each is below 256, as asserted")]
    let layout =
        config as u32 | (cloud as u32) << 8 | (answer as u32) << 16 | (questions as u32) << 24;
    layout
};

impl CAnswer {
    pub(crate) const EMPTY: Self = Self {
        at: 0,
        t: 0,
        due: 0,
        outcome: COutcome::Nothing,
        why: CReason::None,
        by: 0,
        fired: 0,
        timers_len: 0,
        cancelled_len: 0,
        timers: [0; FUSELINE_SOURCES],
        cancelled: [0; FUSELINE_SOURCES],
    };
}
