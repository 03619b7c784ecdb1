//! The gate, and the registered clouds.

use crate::arbitrary::any_gate;
use crate::clouds::{Cloud, Clouds, ConfigError};
use crate::gate::Gate;
use crate::priority::Priority;

/// At any backlog, an open gate shuts at its limit, and a shut one opens at its resume. It admits if it is
/// open afterwards, and does nothing else (F2g, A15, A35).
///
/// Bounds: none.
#[kani::proof]
#[kani::unwind(20)]
pub fn f2g_gate() {
    let [limit, resume]: [u64; 2] = kani::any();
    let made = Gate::new(limit, resume);
    kani::assert(made.is_some() == (resume < limit), "F2g: a gate resumes below its limit");
    let before = any_gate();
    let mut after = before;
    let backlog: u64 = kani::any();
    let admits = after.admits(backlog);
    let shut = if before.shut { backlog > before.resume } else { backlog >= before.limit };
    kani::assert(after.is_shut() == shut, "F2g: it is shut by the rule");
    kani::assert(admits != after.is_shut(), "F2g: it admits when it is open");
    let same = after.limit == before.limit && after.resume == before.resume;
    kani::assert(same, "F2g: nothing else of it changes");
    if let Some(made) = made {
        let is_made = made.limit == limit && made.resume == resume && !made.shut;
        kani::assert(is_made, "F2g: it is open at first");
    }
    kani::cover!(before.shut && admits && before.resume == 0, "it opens at an empty queue");
    kani::cover!(!before.shut && !admits && backlog == u64::MAX, "it shuts at the longest queue");
    kani::cover!(before.shut && !admits && backlog < before.limit, "it stays shut in between");
}

fn any_cloud() -> Cloud {
    let [limit, resume] = kani::any_where(|[limit, resume]: &[u64; 2]| resume < limit);
    Cloud { priority: Priority::new(kani::any()), limit, resume }
}

/// Each cloud is at the index that equals the number of clouds below it, whatever the order in which they are
/// given, and is found only by its priority. Local's priority, equal priorities and a gate that cannot resume
/// are refused (P10, A10).
///
/// Bounds: 2 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p10_order_of_clouds() {
    let [a, b] = [any_cloud(), any_cloud()];
    let local = [a, b].iter().any(|cloud| cloud.priority == Priority::LOCAL);
    let equal = a.priority == b.priority;
    let made = Clouds::<2>::new(&[a, b]);
    kani::assert(made.is_ok() == (!local && !equal), "A10: refused exactly if local's or equal");
    if let Ok(made) = &made {
        kani::assert(made.len == 2, "P10: all are registered");
        for cloud in [a, b] {
            let below = [a, b].iter().filter(|other| other.priority < cloud.priority).count();
            for i in 0..2 {
                let gate = made.gates[i];
                let same = made.priorities[i] == cloud.priority
                    && gate.limit == cloud.limit
                    && gate.resume == cloud.resume
                    && !gate.shut;
                kani::assert(i != below || same, "P10: the order of the clouds means nothing");
            }
        }
        let sought = Priority::new(kani::any());
        let source = made.source(sought);
        let known = made.priorities.iter().position(|priority| *priority == sought);
        let expected = match known {
            _ if sought == Priority::LOCAL => Some(0),
            Some(i) => Some(i + 1),
            None => None,
        };
        let index = source.map(|source| usize::from(source.index()));
        kani::assert(index == expected, "F3: local and the registered are known, no others");
    }
    let wide = Cloud { resume: a.limit, ..a };
    let refused = Clouds::<2>::new(&[wide]);
    let expected = if a.priority == Priority::LOCAL {
        ConfigError::LocalPriority
    } else {
        ConfigError::Gate(a.priority)
    };
    kani::assert(refused.err() == Some(expected), "F2g: a gate that cannot resume is refused");
    kani::cover!(
        made.as_ref().is_ok_and(|made| made.priorities[0] == b.priority),
        "the last is the least"
    );
    kani::cover!(made.is_err() && !local, "two are equal");
}
