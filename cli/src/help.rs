//! The help as people read it: without the marks of rustdoc, and with sentences that wrap where the
//! terminal ends.

use clap::builder::StyledStr;
use clap::{Arg, Command};

/// Returns the command with a help that people can read, and does the same to its subcommands.
pub(crate) fn readable(command: Command) -> Command {
    let texts = [command.get_about(), command.get_long_about(), command.get_after_help()];
    let [about, long_about, after] = texts.map(|text| text.map(to_text));
    let mut command = command.mut_args(readable_arg).mut_subcommands(readable);
    if let Some(about) = about {
        command = command.about(about);
    }
    if let Some(about) = long_about {
        command = command.long_about(about);
    }
    if let Some(after) = after {
        command = command.after_help(after);
    }
    command
}

fn readable_arg(arg: Arg) -> Arg {
    let [help, long] = [arg.get_help(), arg.get_long_help()].map(|text| text.map(to_text));
    let arg = if let Some(help) = help { arg.help(help) } else { arg };
    if let Some(long) = long { arg.long_help(long) } else { arg }
}

fn to_text(text: &StyledStr) -> String {
    unwrapped(&without_marks(&text.to_string()))
}

/// Removes backticks, and the angle brackets around URLs.
fn without_marks(text: &str) -> String {
    let mut left = String::new();
    let mut rest = text;
    while let Some((before, link)) = rest.split_once("<http") {
        let (link, after) = link.split_once('>').unwrap_or((link, ""));
        left.extend([before, "http", link]);
        rest = after;
    }
    (left + rest).replace('`', "")
}

/// Joins the lines of each paragraph. Indented lines stay as they are.
fn unwrapped(text: &str) -> String {
    let mut joined = String::new();
    let is_flush = |line: &str| !line.is_empty() && !line.starts_with(' ');
    let mut was_flush = false;
    for line in text.lines() {
        let goes_on = was_flush && is_flush(line);
        if !joined.is_empty() {
            joined.push(if goes_on { ' ' } else { '\n' });
        }
        joined.push_str(line);
        was_flush = is_flush(line);
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_rustdoc_are_no_help() {
        let text = "As `JUnit` XML, at <http://HOST:PORT>, or <https://HOST>.";
        assert_eq!(without_marks(text), "As JUnit XML, at http://HOST:PORT, or https://HOST.");
        assert_eq!(without_marks("a < b"), "a < b");
    }

    #[test]
    fn a_paragraph_is_one_line_and_a_list_is_not() {
        let text = "One sentence that\nis broken.\n\nExamples:\n  first\n  second\nAnd\nmore.";
        let expected = "One sentence that is broken.\n\nExamples:\n  first\n  second\nAnd more.";
        assert_eq!(unwrapped(text), expected);
    }
}
