//! `--write-header`: the header of a trace, from what is asked.

use std::io::{self, BufRead, Write};

use fuseline_traces::{Cloud, Commit, Header};
use thiserror::Error;

use crate::fault::Fault;

/// The queue limit of a gate where nobody says another.
const LIMIT: u64 = 31;
const WINDOW: &str = "16";

/// The reason why no header can be written.
#[derive(Debug, Error)]
enum HeaderAnswerError {
    #[error(
        "--write-header asks for {0}, but standard input has ended; answer there, one line for \
         each question"
    )]
    Ended(String),
    #[error("--write-header: {answer:?} is not {wanted}")]
    Wrong { answer: String, wanted: &'static str },
    #[error("--write-header: the answers cannot be read: {0}")]
    Read(#[from] io::Error),
}

impl From<HeaderAnswerError> for Fault {
    fn from(error: HeaderAnswerError) -> Self {
        Self::own(error)
    }
}

/// Returns a header whose clouds are `sources`, each a name or a priority, asked for what cannot be
/// guessed. Questions are put on `prompt`; an empty answer is the default, where there is one.
pub(super) fn ask(
    sources: &[String],
    answers: &mut impl BufRead,
    prompt: &mut impl Write,
) -> Result<Header, Fault> {
    let mut clouds: Vec<Cloud> = Vec::new();
    let mut asking = HeaderQuestions { answers, prompt };
    let text = |answer: &str| Some(answer.to_owned()).filter(|text| !text.is_empty());
    for source in sources {
        let (name, p) = if let Ok(p) = source.parse() {
            (
                asking
                    .ask(&format!("name of the source {p}"), "", "a name", |it| Some(text(it)))?,
                p,
            )
        } else {
            let question = format!("priority of {source}, the greater the better");
            let wanted = "a priority from 1 to 65535";
            let priority = |it: &str| it.parse().ok().filter(|p: &u16| *p > 0);
            (Some(source.clone()), asking.ask(&question, "", wanted, priority)?)
        };
        if clouds.iter().any(|cloud| cloud.p == p) {
            let wanted = "a priority that no other source has";
            return Err(HeaderAnswerError::Wrong { answer: p.to_string(), wanted }.into());
        }
        clouds.push(Cloud { p, name, limit: LIMIT, resume: LIMIT - 1 });
    }
    let operator = asking.ask("the operator's name", "", "a name", |it| Some(text(it)))?;
    let (what, rules) = ("commit rule: ", "eager, patient or progressive");
    let commit = asking.ask(&format!("{what}{rules}"), "eager", rules, |it| {
        [Commit::Eager, Commit::Patient, Commit::Progressive]
            .into_iter()
            .find(|rule| rule.as_str() == it)
    })?;
    let what = "how many messages may be open at once";
    let window = asking.ask(what, WINDOW, "a window from 1 to 1024", |it| {
        it.parse().ok().filter(|window| (1..=1024).contains(window))
    })?;
    clouds.sort_by_key(|cloud| cloud.p);
    Ok(Header { operator, window, commit, clouds })
}

struct HeaderQuestions<'a, A, P> {
    answers: &'a mut A,
    prompt: &'a mut P,
}

impl<A: BufRead, P: Write> HeaderQuestions<'_, A, P> {
    /// Asks, and reads the answer by `read`; an empty one is the default.
    fn ask<T>(
        &mut self,
        what: &str,
        default: &str,
        wanted: &'static str,
        read: impl FnOnce(&str) -> Option<T>,
    ) -> Result<T, HeaderAnswerError> {
        let shown = if default.is_empty() { String::new() } else { format!(" [{default}]") };
        // A user who sees no question still has to answer it.
        let _ = write!(self.prompt, "{what}{shown}: ").and_then(|()| self.prompt.flush());
        let mut answer = String::new();
        if self.answers.read_line(&mut answer)? == 0 && default.is_empty() {
            return Err(HeaderAnswerError::Ended(what.to_owned()));
        }
        let answer = answer.trim();
        let answer = if answer.is_empty() { default } else { answer };
        let wrong = || HeaderAnswerError::Wrong { answer: answer.to_owned(), wanted };
        read(answer).ok_or_else(wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(sources: &[&str], answers: &str) -> Result<String, String> {
        let sources: Vec<String> = sources.iter().map(|name| (*name).to_owned()).collect();
        let header = ask(&sources, &mut answers.as_bytes(), &mut io::sink());
        let header = header.map_err(|fault| fault.to_string())?;
        let mut line = Vec::new();
        header.write(&mut line);
        Ok(String::from_utf8(line).unwrap())
    }

    #[test]
    fn a_header_has_what_was_answered() {
        let header = asked(&["west", "2"], "1\neast\ndetector\npatient\n\n").unwrap();
        assert!(header.contains(r#""operator":"detector""#) && header.contains(r#""window":16"#));
        assert!(header.contains(r#""commit":"patient""#), "{header}");
        assert!(header.contains(r#"{"p":1,"name":"west","#), "{header}");
        assert!(header.contains(r#"{"p":2,"name":"east","#), "{header}");
    }

    #[test]
    fn a_wrong_answer_and_none_are_reported() {
        for (sources, answers, expected) in [
            (&["west"][..], "0\n", "\"0\" is not a priority from 1 to 65535"),
            (&["west"], "", "asks for priority of west"),
            (&["west", "east"], "1\n1\n", "\"1\" is not a priority that no other source has"),
            (&[], "x\nlazy\n", "\"lazy\" is not eager, patient or progressive"),
            (&[], "x\n\n0\n", "\"0\" is not a window from 1 to 1024"),
        ] {
            let fault = asked(sources, answers).unwrap_err();
            assert!(fault.contains(expected), "{answers:?}: {fault}");
        }
    }
}
