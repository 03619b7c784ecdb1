//! Does with the shipped core what each line of standard input says, and prints the answer, a line for each.
//!
//! `proofs/rules/runner/code.py` writes the lines and compares the answers with the rules. Sets are numbers whose bits are the members.
//!
//! | line | is answered by |
//! |---|---|
//! | `slot COMMIT REQUESTED PENDING ARMED CACHED` | `valid` or `invalid` |
//! | the same, then `result`, `failure`, `timers` or `offer` and a number | the four sets after it, and the decision |
//! | `machine COMMIT WINDOW` and for each cloud `PRIORITY LIMIT RESUME` | `made` |
//! | an instant, then `open T [DEADLINE]`, `offer T P DEADLINE BACKLOG`, `result T P`, `fail T P` or nothing | what fired, the answer, the machine |

mod machine;
mod slot;

use std::error::Error;
use std::io::{self, BufRead, Write};

/// What is wrong with a line.
type Refusal = Box<dyn Error>;

fn main() -> Result<(), Refusal> {
    let mut out = io::BufWriter::new(io::stdout().lock());
    let mut machine = None;
    for (number, line) in (1_u32..).zip(io::stdin().lock().lines()) {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let answer = match words.split_first() {
            Some((&"slot", words)) => slot::answer(words),
            Some((&"machine", words)) => machine::make(words).map(|made| {
                machine = Some(made);
                "made".to_owned()
            }),
            Some(_) => match &mut machine {
                Some(machine) => machine::answer(machine, &words),
                None => Err("no machine was made yet".into()),
            },
            None => Err("it is empty".into()),
        };
        match answer {
            Ok(answer) => writeln!(out, "{answer}")?,
            Err(why) => return Err(format!("line {number}: {why}").into()),
        }
    }
    Ok(out.flush()?)
}

/// The number that a word is.
fn number<T: std::str::FromStr>(word: &str) -> Result<T, Refusal> {
    word.parse().map_err(|_| format!("{word} is not a number here").into())
}
