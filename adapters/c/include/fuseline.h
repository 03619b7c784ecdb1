#ifndef FUSELINE_H
#define FUSELINE_H
/*
 * Fuseline for C: which result of a message is forwarded, and when. SPEC.md has the rules (F), promises (P) and
 * ambiguities (A) that are named here.
 *
 * Made by cbindgen from adapters/c/src; do not edit.
 *
 * How to drive a machine:
 *
 *   1. Give it storage and a configuration: fuseline_init.
 *   2. At each thing that happens, and at fuseline_next_due, read your monotonic clock (nanoseconds) and report what
 *      happened: fuseline_open, _offer, _result, _fail, or fuseline_tick if nothing did. While the status is
 *      FUSELINE_STATUS_AGAIN timers fired first (F5): act on the answer and make the same call again, with the same instant.
 *
 *          do {
 *            status = fuseline_result(machine, now, t, p, &answer);
 *            ... answer.outcome of message answer.t: forward, report a miss, hold, drop ...
 *          } while (status == FUSELINE_STATUS_AGAIN);
 *
 *      There are at most as many firings as armed timers. Nanoseconds have no sign here: make instants and deadlines by
 *      fuseline_instant and fuseline_deadline, which refuse what is below 0, and not by a difference.
 *   3. Keep the values: that of a held result until its message is forwarded or missed.
 *
 * What holds for all calls: nothing is allocated, nothing blocks, nothing panics or throws, and the answer is the
 * whole effect. A null or misaligned pointer, a storage that is too small, not a machine, or copied from elsewhere, an
 * answer within the machine or within another answer, and a call from within another (an interrupt, a signal) are
 * answered by the status and change nothing. What is not detected: a pointer that is neither null nor to memory of the
 * right size, storage that somebody else writes or restores, a process that forks and goes on in both, and two threads
 * that call one machine at the same time. One machine is for one thread at a time; two machines know nothing of each
 * other.
 */


#include <stddef.h>
#include <stdint.h>

/* The version of this header; fuseline_version says the library's. */
#define FUSELINE_VERSION "0.1.0"

#if defined(__cplusplus)
#define FUSELINE_CHECKED [[nodiscard]]
#elif defined(__GNUC__)
#define FUSELINE_CHECKED __attribute__((warn_unused_result))
#else
#define FUSELINE_CHECKED
#endif

#if defined(__cplusplus)
#define FUSELINE_CAST(type, value) static_cast<type>(value)
#else
#define FUSELINE_CAST(type, value) ((type)(value))
#endif

#if defined(__cplusplus)
#define FUSELINE_ALIGNED(bytes) alignas(bytes)
#elif defined(__GNUC__)
#define FUSELINE_ALIGNED(bytes) __attribute__((aligned(bytes)))
#else
#define FUSELINE_ALIGNED(bytes) _Alignas(bytes)
#endif

/**
 * The version of this interface. A library refuses a header of another one.
 */
#define FUSELINE_ABI 2

/**
 * The most sources of a machine: local and 15 clouds.
 */
#define FUSELINE_SOURCES 16

/**
 * Of the bytes that a machine's storage takes: those that each machine takes.
 */
#define FUSELINE_BYTES 256

/**
 * Those for each cloud.
 */
#define FUSELINE_BYTES_A_CLOUD 64

/**
 * Those for each timestamp of the window.
 */
#define FUSELINE_BYTES_A_TIMESTAMP 96

/**
 * Those for each timestamp and cloud.
 */
#define FUSELINE_BYTES_A_TIMER 8

/**
 * Of the bytes that the storage of a machine for many threads takes: those that each machine takes.
 */
#define FUSELINE_SHARED_BYTES 256

/**
 * Those for each cloud.
 */
#define FUSELINE_SHARED_BYTES_A_CLOUD 128

/**
 * Whether a call was applied. From FUSELINE_STATUS_NULL on it was wrong and changed nothing.
 */
enum fuseline_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * The input was applied: the answer is its own.
   */
  FUSELINE_STATUS_DONE = 0,
  /**
   * Timers fired first (F5): the answer is theirs and the input was not applied. Act on the answer, then make the
   * same call again.
   */
  FUSELINE_STATUS_AGAIN = 1,
  /**
   * There is nothing to report: no timer is armed, the timestamp is not open, or the priority is no cloud's.
   */
  FUSELINE_STATUS_NONE = 2,
  /**
   * A pointer is null.
   */
  FUSELINE_STATUS_NULL = 16,
  /**
   * A pointer is not aligned for what it points to.
   */
  FUSELINE_STATUS_ALIGNMENT = 17,
  /**
   * The storage is too small for the capacity.
   */
  FUSELINE_STATUS_SIZE = 18,
  /**
   * An answer would lie in the machine's storage, or two answers of one call would share bytes.
   */
  FUSELINE_STATUS_OVERLAP = 19,
  /**
   * No machine is there: never initialised, ended, copied from elsewhere, or overwritten.
   */
  FUSELINE_STATUS_FOREIGN = 20,
  /**
   * Another call to this machine is under way, which this one interrupted.
   */
  FUSELINE_STATUS_BUSY = 21,
  /**
   * The header is of another version than the library.
   */
  FUSELINE_STATUS_ABI = 22,
  /**
   * The library does not hold a machine of exactly this many clouds and this window.
   */
  FUSELINE_STATUS_CAPACITY = 23,
  /**
   * No such commit rule.
   */
  FUSELINE_STATUS_COMMIT = 24,
  /**
   * The window is 0 or above the capacity.
   */
  FUSELINE_STATUS_WINDOW = 25,
  /**
   * There are more clouds than the capacity allows.
   */
  FUSELINE_STATUS_CLOUDS = 26,
  /**
   * A cloud's priority is not from 1 to 65535.
   */
  FUSELINE_STATUS_PRIORITY = 27,
  /**
   * Two clouds have one priority (A10).
   */
  FUSELINE_STATUS_TWICE = 28,
  /**
   * A cloud's gate does not resume below its limit (F2g).
   */
  FUSELINE_STATUS_GATE = 29,
  /**
   * The greatest deadline is 0: every deadline would be refused.
   */
  FUSELINE_STATUS_DEADLINE = 30,
  /**
   * The message id names no message of this machine: another machine gave it, or none did.
   */
  FUSELINE_STATUS_MESSAGE_ID = 31,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum fuseline_status fuseline_status;
#else
typedef uint32_t fuseline_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What became of an input, or of timers that fired.
 */
enum fuseline_outcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * A tick: time went by.
   */
  FUSELINE_OUTCOME_NOTHING = 0,
  /**
   * Open: the timestamp is open and waits for local.
   */
  FUSELINE_OUTCOME_ACCEPTED = 1,
  /**
   * Open, offer: for the reason `why`; nothing changed but a gate. A refused request must not be sent.
   */
  FUSELINE_OUTCOME_REFUSED = 2,
  /**
   * Offer: send the request; its result is in time before `due`.
   */
  FUSELINE_OUTCOME_ADMITTED = 3,
  /**
   * Result: keep its value, for something pending outranks it.
   */
  FUSELINE_OUTCOME_HELD = 4,
  /**
   * Send the value of `by` downstream. The timestamp is retired: discard what else is held for it, and abort the
   * calls of `cancelled` if you like.
   */
  FUSELINE_OUTCOME_FORWARDED = 5,
  /**
   * Result, failure: for the reason `why`; nothing changed. Discard its value.
   */
  FUSELINE_OUTCOME_DROPPED = 6,
  /**
   * Nothing came and nothing will: the timestamp is retired.
   */
  FUSELINE_OUTCOME_MISSED = 7,
  /**
   * Failure, timers: the timestamp stays open.
   */
  FUSELINE_OUTCOME_WAITING = 8,
  /**
   * Result, progressive alone: send the value of `by` downstream, and abort the calls of `cancelled` if you like. The
   * timestamp stays open for better values, until the last is FUSELINE_OUTCOME_FORWARDED or FUSELINE_OUTCOME_FINAL comes.
   */
  FUSELINE_OUTCOME_PRELIMINARY = 9,
  /**
   * Failure, timers, progressive alone: the value of `by`, sent before, was the last. The timestamp is retired, and there
   * is nothing to send.
   */
  FUSELINE_OUTCOME_FINAL = 10,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum fuseline_outcome fuseline_outcome;
#else
typedef uint32_t fuseline_outcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Why an input was refused or dropped: the first reason that holds, in the order of SPEC.md.
 */
enum fuseline_reason
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * It was neither.
   */
  FUSELINE_REASON_NONE = 0,
  /**
   * Open: this timestamp or a later one was opened before.
   */
  FUSELINE_REASON_ORDER = 1,
  /**
   * Open: as many timestamps are open as the window allows.
   */
  FUSELINE_REASON_FULL = 2,
  /**
   * Open, offer: the due instant is not after now, or the deadline is above the greatest one of the configuration.
   */
  FUSELINE_REASON_DEADLINE = 3,
  /**
   * No such source, or neither this timestamp nor a later one was ever opened.
   */
  FUSELINE_REASON_UNKNOWN = 4,
  /**
   * Offer: the timestamp is not open.
   */
  FUSELINE_REASON_CLOSED = 5,
  /**
   * The cloud was requested before; the source's result is already held or, under progressive, was sent last.
   */
  FUSELINE_REASON_DUPLICATE = 6,
  /**
   * Offer: a held result, or under progressive the last one sent, outranks whatever this cloud would return.
   */
  FUSELINE_REASON_OUTRANKED = 7,
  /**
   * Offer: the cloud's gate is shut.
   */
  FUSELINE_REASON_QUEUE = 8,
  /**
   * Result, failure: the timestamp is not open or, under progressive, the last result sent outranks the source's.
   */
  FUSELINE_REASON_SUPERSEDED = 9,
  /**
   * Result, failure: no request was made to the source.
   */
  FUSELINE_REASON_UNSOLICITED = 10,
  /**
   * Result, failure: the request was closed by its timer or by a failure.
   */
  FUSELINE_REASON_LATE = 11,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum fuseline_reason fuseline_reason;
#else
typedef uint32_t fuseline_reason;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * How much a machine has room for: 65536 times the clouds, plus the open timestamps (FUSELINE_CAPACITY_OF). A library
 * may hold one more: that of FUSELINE_OWN_CLOUDS and FUSELINE_OWN_WINDOW, see fuseline_own_capacity.
 */
enum fuseline_capacity
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * 1 cloud, a window of 4.
   */
  FUSELINE_CAPACITY_C1W4 = 65540,
  /**
   * 3 clouds, a window of 16.
   */
  FUSELINE_CAPACITY_C3W16 = 196624,
  /**
   * 7 clouds, a window of 64.
   */
  FUSELINE_CAPACITY_C7W64 = 458816,
  /**
   * 15 clouds, a window of 1024: whatever SPEC.md allows.
   */
  FUSELINE_CAPACITY_C15W1024 = 984064,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum fuseline_capacity fuseline_capacity;
#else
typedef uint32_t fuseline_capacity;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * When a result is forwarded although a better one is pending (F6, F9).
 */
enum fuseline_commit
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * The first cloud's timer that fires commits the best available one.
   */
  FUSELINE_COMMIT_EAGER = 0,
  /**
   * The best available one is forwarded once nothing pending outranks it.
   */
  FUSELINE_COMMIT_PATIENT = 1,
  /**
   * Each result that is better than those before it is sent at once: FUSELINE_OUTCOME_PRELIMINARY while better ones may
   * follow.
   */
  FUSELINE_COMMIT_PROGRESSIVE = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum fuseline_commit fuseline_commit;
#else
typedef uint32_t fuseline_commit;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What a machine's storage begins with. Opaque to the caller.
 */
typedef struct fuseline_machine fuseline_machine;

/**
 * A machine for many threads, in its caller's storage. Opaque.
 */
typedef struct fuseline_shared fuseline_shared;

/**
 * One cloud as configured.
 */
typedef struct fuseline_cloud {
  /**
   * 1 to 65535, unlike every other cloud's; the greater wins.
   */
  uint64_t priority;
  /**
   * The gate shuts at this many queued requests; at least 1.
   */
  uint64_t limit;
  /**
   * The shut gate opens at this many queued requests or fewer; less than `limit`.
   */
  uint64_t resume;
} fuseline_cloud;

/**
 * What a machine is made for. FUSELINE_CONFIG gives the first two members.
 */
typedef struct fuseline_config {
  /**
   * FUSELINE_ABI.
   */
  uint32_t abi;
  /**
   * FUSELINE_LAYOUT.
   */
  uint32_t layout;
  /**
   * A fuseline_capacity, or FUSELINE_CAPACITY_OF your own.
   */
  uint32_t capacity;
  /**
   * A fuseline_commit.
   */
  uint32_t commit;
  /**
   * How many timestamps may be open at once: 1 to the capacity's.
   */
  uint32_t window;
  /**
   * How many clouds there are: 0 to the capacity's.
   */
  uint32_t clouds_len;
  /**
   * The clouds in any order; may be null if there is none. Not used after the call.
   */
  const struct fuseline_cloud *clouds;
  /**
   * A deadline of more nanoseconds is refused, FUSELINE_REASON_DEADLINE: so is a negative one, which is huge without
   * its sign. 1 or more; what the system may wait for a message in the worst case.
   */
  uint64_t greatest_deadline;
} fuseline_config;

/**
 * What a call decided, whole: nothing else happened.
 */
typedef struct fuseline_answer {
  /**
   * The machine's clock at which it was decided, in nanoseconds (F0).
   */
  uint64_t at;
  /**
   * The timestamp that it is about; of a tick 0.
   */
  uint64_t t;
  /**
   * When the timers that fired were due, or by when an admitted request's result must be there; else 0.
   */
  uint64_t due;
  /**
   * What became of the input or of the timers.
   */
  fuseline_outcome outcome;
  /**
   * Why it was refused or dropped.
   */
  fuseline_reason why;
  /**
   * Forwarded, preliminary, final: whose result; 0 is local's. Else 0.
   */
  uint32_t by;
  /**
   * 1 if timers fired (FUSELINE_STATUS_AGAIN), else 0.
   */
  uint32_t fired;
  /**
   * How many of `timers` mean something; the others are 0.
   */
  uint32_t timers_len;
  /**
   * How many of `cancelled` mean something; the others are 0.
   */
  uint32_t cancelled_len;
  /**
   * The priorities whose timers fired, ascending; 0 is local's.
   */
  uint16_t timers[FUSELINE_SOURCES];
  /**
   * Forwarded, preliminary: the clouds whose results are no longer wanted, ascending.
   */
  uint16_t cancelled[FUSELINE_SOURCES];
} fuseline_answer;

/**
 * The state of a machine as a whole.
 */
typedef struct fuseline_state {
  /**
   * The greatest instant seen, in nanoseconds.
   */
  uint64_t now;
  /**
   * The greatest timestamp ever opened; means something if `has_newest` is 1.
   */
  uint64_t newest;
  /**
   * The next due instant; means something if `has_due` is 1.
   */
  uint64_t due;
  /**
   * 1 if a timestamp was ever opened, else 0.
   */
  uint32_t has_newest;
  /**
   * 1 if a timer is armed, else 0.
   */
  uint32_t has_due;
  /**
   * How many timestamps are open.
   */
  uint32_t open_len;
  /**
   * How many may be.
   */
  uint32_t window;
} fuseline_state;

/**
 * The state of an open timestamp: sets of sources, a bit each. Bit `i` is the source `priorities[i]`.
 */
typedef struct fuseline_message {
  /**
   * When each source's timer is due, if it is in `armed`.
   */
  uint64_t dues[FUSELINE_SOURCES];
  /**
   * The sources' priorities, ascending; the first is local's, 0.
   */
  uint16_t priorities[FUSELINE_SOURCES];
  /**
   * How many sources there are: local and the clouds.
   */
  uint32_t sources_len;
  /**
   * Requested.
   */
  uint32_t requested;
  /**
   * Requested, and neither result nor failure nor timer has come.
   */
  uint32_t pending;
  /**
   * Those whose timer is live.
   */
  uint32_t armed;
  /**
   * Those whose result is held; under progressive the one whose result was sent last.
   */
  uint32_t cached;
  /**
   * 0.
   */
  uint32_t reserved;
} fuseline_message;

/**
 * Names one open message to the machine for many threads that opened it. Another machine refuses it, and one that is
 * all 0, FUSELINE_STATUS_MESSAGE_ID.
 */
typedef struct fuseline_message_id {
  /**
   * Opaque.
   */
  uint64_t opaque[3];
} fuseline_message_id;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library: FUSELINE_ABI where its header fits.
 */
uint32_t fuseline_abi(void);

/**
 * The version of the library, as FUSELINE_VERSION is the header's: "0.1.0".
 */
FUSELINE_CHECKED const char *fuseline_version(void);

/**
 * The capacity that the library was built for beside the named ones; 0 if there is none.
 */
uint32_t fuseline_own_capacity(void);

/**
 * A deadline from a signed number of units, of `unit` nanoseconds each, as in
 * fuseline_deadline(budget_ms - age_ms, FUSELINE_MILLISECOND): 0, which is refused, if it is negative; UINT64_MAX,
 * which is above every greatest deadline but itself, if it does not fit.
 */
FUSELINE_CHECKED
uint64_t fuseline_deadline(int64_t count,
                           uint64_t unit);

/**
 * An instant from a reading of CLOCK_MONOTONIC or its like: a struct timespec's seconds and nanoseconds. 0 if it is
 * negative; UINT64_MAX if it does not fit.
 */
FUSELINE_CHECKED
uint64_t fuseline_instant(int64_t seconds,
                          int64_t nanoseconds);

/**
 * How many bytes of storage a capacity takes in this library; 0 if it does not hold it.
 */
size_t fuseline_bytes(uint32_t capacity);

/**
 * Makes a machine in `storage`, of which `bytes` bytes are given to it until fuseline_end, aligned as a uint64_t.
 *
 * The storage is not read: a machine that is there already is lost. Nothing is written unless it is done; then
 * `*machine` is what the other functions take. It must stay where it is.
 */
FUSELINE_CHECKED
fuseline_status fuseline_init(void *storage,
                              size_t bytes,
                              const struct fuseline_config *config,
                              struct fuseline_machine **machine);

/**
 * Ends a machine: its storage is the caller's again, and further calls to it are answered FUSELINE_STATUS_FOREIGN.
 */
FUSELINE_CHECKED
fuseline_status fuseline_end(struct fuseline_machine *machine);

/**
 * F1: a message with timestamp `t` came.
 */
FUSELINE_CHECKED
fuseline_status fuseline_open(struct fuseline_machine *machine,
                              uint64_t now,
                              uint64_t t,
                              struct fuseline_answer *answer);

/**
 * F1: a message with timestamp `t` came, and local may take `deadline` nanoseconds for it.
 */
FUSELINE_CHECKED
fuseline_status fuseline_open_within(struct fuseline_machine *machine,
                                     uint64_t now,
                                     uint64_t t,
                                     uint64_t deadline,
                                     struct fuseline_answer *answer);

/**
 * F2: may message `t` be sent to cloud `p`, which may take `deadline` nanoseconds and in whose outgoing queue
 * `backlog` others wait?
 */
FUSELINE_CHECKED
fuseline_status fuseline_offer(struct fuseline_machine *machine,
                               uint64_t now,
                               uint64_t t,
                               uint64_t p,
                               uint64_t deadline,
                               uint64_t backlog,
                               struct fuseline_answer *answer);

/**
 * F3: the result of source `p` came; 0 is local.
 */
FUSELINE_CHECKED
fuseline_status fuseline_result(struct fuseline_machine *machine,
                                uint64_t now,
                                uint64_t t,
                                uint64_t p,
                                struct fuseline_answer *answer);

/**
 * F4: no result will come from source `p`; 0 is local.
 */
FUSELINE_CHECKED
fuseline_status fuseline_fail(struct fuseline_machine *machine,
                              uint64_t now,
                              uint64_t t,
                              uint64_t p,
                              struct fuseline_answer *answer);

/**
 * F0: time went by. Call it at the next due instant, and as often besides as you like (P10).
 */
FUSELINE_CHECKED
fuseline_status fuseline_tick(struct fuseline_machine *machine,
                              uint64_t now,
                              struct fuseline_answer *answer);

/**
 * Question: the earliest instant at which a timer is due, or FUSELINE_STATUS_NONE if none is armed.
 */
FUSELINE_CHECKED fuseline_status fuseline_next_due(struct fuseline_machine *machine, uint64_t *due);

/**
 * Question: the state of the machine as a whole.
 */
FUSELINE_CHECKED
fuseline_status fuseline_look(struct fuseline_machine *machine,
                              struct fuseline_state *state);

/**
 * Question: the state of timestamp `t`, or FUSELINE_STATUS_NONE if it is not open.
 */
FUSELINE_CHECKED
fuseline_status fuseline_look_at(struct fuseline_machine *machine,
                                 uint64_t t,
                                 struct fuseline_message *message);

/**
 * Question: 1 if the gate of cloud `p` was left shut, else 0; FUSELINE_STATUS_NONE if there is no such cloud.
 */
FUSELINE_CHECKED
fuseline_status fuseline_gate_is_shut(struct fuseline_machine *machine,
                                      uint64_t p,
                                      uint32_t *is_shut);

/**
 * The word for a fuseline_status; "?" for another number.
 */
FUSELINE_CHECKED const char *fuseline_status_name(uint32_t status);

/**
 * The word for a fuseline_outcome; "?" for another number.
 */
FUSELINE_CHECKED const char *fuseline_outcome_name(uint32_t outcome);

/**
 * The word of SPEC.md for a fuseline_reason; "?" for another number.
 */
FUSELINE_CHECKED const char *fuseline_reason_name(uint32_t reason);

/**
 * How many bytes of storage, aligned to 64, a machine for many threads takes in this library; 0 if it does not hold the
 * capacity.
 */
size_t fuseline_shared_bytes(uint32_t capacity);

/**
 * Makes a machine for many threads (SPEC.md, section 8) in `storage`, aligned to 64 bytes. As fuseline_init otherwise.
 *
 * One thread at a time opens and offers; any thread gives results, failures and time, each for one message id. Call no
 * function of it before this one returned, and none while or after it is ended.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_init(void *storage,
                                     size_t bytes,
                                     const struct fuseline_config *config,
                                     struct fuseline_shared **machine);

/**
 * Ends a machine, when no thread calls it any more: its storage is the caller's again.
 */
FUSELINE_CHECKED fuseline_status fuseline_shared_end(struct fuseline_shared *machine);

/**
 * F1, the owner's: a message came. `*message_id` names it if it is accepted, else nothing.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_open(struct fuseline_shared *machine,
                                     uint64_t now,
                                     uint64_t t,
                                     struct fuseline_message_id *message_id,
                                     struct fuseline_answer *answer);

/**
 * F1, the owner's: a message came, and local may take `deadline` nanoseconds for it.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_open_within(struct fuseline_shared *machine,
                                            uint64_t now,
                                            uint64_t t,
                                            uint64_t deadline,
                                            struct fuseline_message_id *message_id,
                                            struct fuseline_answer *answer);

/**
 * F2, the owner's: may the message be sent to cloud `p`? `fired` says first which of its timers were due. In all functions
 * with two answers they are two objects: one object for both is FUSELINE_STATUS_OVERLAP.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_offer(struct fuseline_shared *machine,
                                      uint64_t now,
                                      struct fuseline_message_id message_id,
                                      uint64_t p,
                                      uint64_t deadline,
                                      uint64_t backlog,
                                      struct fuseline_answer *fired,
                                      struct fuseline_answer *answer);

/**
 * F3, any thread's: the result of source `p` came. `fired` says first which of the message's timers were due by `now`,
 * several due instants as one firing. Of all callers exactly one gets FUSELINE_OUTCOME_FORWARDED; under progressive exactly
 * one gets each output and one the end.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_result(struct fuseline_shared *machine,
                                       uint64_t now,
                                       struct fuseline_message_id message_id,
                                       uint64_t p,
                                       struct fuseline_answer *fired,
                                       struct fuseline_answer *answer);

/**
 * F4, any thread's: no result will come from source `p`.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_fail(struct fuseline_shared *machine,
                                     uint64_t now,
                                     struct fuseline_message_id message_id,
                                     uint64_t p,
                                     struct fuseline_answer *fired,
                                     struct fuseline_answer *answer);

/**
 * F5, any thread's: time went by for this message.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_expire(struct fuseline_shared *machine,
                                       uint64_t now,
                                       struct fuseline_message_id message_id,
                                       struct fuseline_answer *fired,
                                       struct fuseline_answer *answer);

/**
 * Question, any thread's: when a timer of this message is due next, or FUSELINE_STATUS_NONE.
 */
FUSELINE_CHECKED
fuseline_status fuseline_shared_next_due(struct fuseline_shared *machine,
                                         struct fuseline_message_id message_id,
                                         uint64_t *due);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

/*
 * The bytes of storage for so many clouds and timestamps: more than a machine takes, so that it may change within a
 * version of the interface. fuseline_bytes says how many it takes.
 */
#define FUSELINE_STORAGE_BYTES(clouds, window) \
  (FUSELINE_BYTES + (FUSELINE_BYTES_A_CLOUD * (clouds)) + \
   ((window) * (FUSELINE_BYTES_A_TIMESTAMP + (FUSELINE_BYTES_A_TIMER * (clouds)))))

/* The number of a capacity of your own, for the configuration: it must be exactly what the library was built for. */
#define FUSELINE_CAPACITY_OF(clouds, window) \
  ((FUSELINE_CAST(uint32_t, (clouds)) << 16) | FUSELINE_CAST(uint32_t, (window)))

/* Nanoseconds, of 64 bits: a product of two of them, or with an int, does not wrap at 32. */
#define FUSELINE_NANOSECOND UINT64_C(1)
#define FUSELINE_MICROSECOND UINT64_C(1000)
#define FUSELINE_MILLISECOND UINT64_C(1000000)
#define FUSELINE_SECOND UINT64_C(1000000000)

/* The storage of a machine, for static memory or a stack; give its address and its sizeof to fuseline_init. */
#define FUSELINE_STORAGE(clouds, window) \
  struct { uint64_t opaque[FUSELINE_STORAGE_BYTES((clouds), (window)) / 8]; }

typedef FUSELINE_STORAGE(1, 4) fuseline_storage_c1w4;
typedef FUSELINE_STORAGE(3, 16) fuseline_storage_c3w16;
typedef FUSELINE_STORAGE(7, 64) fuseline_storage_c7w64;
typedef FUSELINE_STORAGE(15, 1024) fuseline_storage_c15w1024;

/* The same for a machine for many threads, for fuseline_shared_init; aligned to 64 bytes (from C11 on, or by GCC or clang). */
#define FUSELINE_SHARED_STORAGE_BYTES(clouds, window) \
  (FUSELINE_SHARED_BYTES + (FUSELINE_SHARED_BYTES_A_CLOUD * (clouds)) + \
   ((window) * ((((8 * (clouds)) + 87) / 64) * 64)))

#define FUSELINE_SHARED_STORAGE(clouds, window) \
  struct { FUSELINE_ALIGNED(64) uint64_t opaque[FUSELINE_SHARED_STORAGE_BYTES((clouds), (window)) / 8]; }

/* The sizes of what crosses the border, as this compiler lays them out. */
#define FUSELINE_LAYOUT \
  (FUSELINE_CAST(uint32_t, sizeof(fuseline_config)) | \
   (FUSELINE_CAST(uint32_t, sizeof(fuseline_cloud)) << 8) | \
   (FUSELINE_CAST(uint32_t, sizeof(fuseline_answer)) << 16) | \
   (FUSELINE_CAST(uint32_t, sizeof(fuseline_state) ^ sizeof(fuseline_message)) << 24))

/* The head of an initialiser: fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C3W16, ...}; */
#define FUSELINE_CONFIG FUSELINE_ABI, FUSELINE_LAYOUT

#endif /* FUSELINE_H */
