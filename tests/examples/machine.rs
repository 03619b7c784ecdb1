//! The core behind the protocol of `fuseline drive`, and nothing else, so that a build with a fault
//! takes seconds.

use std::io::{self, BufRead, Write};

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::{Event, Line, parse};

fn main() -> io::Result<()> {
    let (mut arbiter, mut answer) = (None, Vec::new());
    for line in io::stdin().lock().lines() {
        match (parse(line?.as_bytes()).expect("a line of the protocol"), &mut arbiter) {
            (Line::Header(header), arbiter) => {
                *arbiter = Some(Arbiter::new(&header).expect("a sound configuration"));
            }
            (Line::Event(Event::Input(input)), Some(arbiter)) => {
                let arbiter: &mut Arbiter = arbiter;
                arbiter.decide(&input, |decision| {
                    decision.write(&mut answer);
                    answer.push(b'\n');
                });
            }
            (line, _) => panic!("neither a header nor an input behind one: {line:?}"),
        }
        answer.extend_from_slice(b"{\"ev\":\"done\"}\n");
        let mut out = io::stdout().lock();
        out.write_all(&answer)?;
        out.flush()?;
        answer.clear();
    }
    Ok(())
}
