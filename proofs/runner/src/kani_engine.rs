//! Kani itself, where it is installed. What it prints is read as its documentation describes it.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::error::Error;

/// Lets Kani prove all harnesses, or those named. Seeded faults are not tried: that is the other engine's part.
///
/// # Errors
/// Kani cannot be started.
pub(crate) fn run(
    tree: &Path,
    all: &[&str],
    wanted: &[String],
    seconds: u64,
) -> Result<bool, Error> {
    let mut command = Command::new("cargo");
    command.current_dir(tree).args(["kani", "-p", "fuseline-proofs", "--output-format", "terse"]);
    command.args(["--harness-timeout", &format!("{seconds}s")]);
    for name in wanted {
        command.args(["--harness", name]);
    }
    command.stdin(Stdio::null()).stderr(Stdio::inherit());
    let output = command.output().map_err(Error::file(Path::new("cargo")))?;
    let printed = String::from_utf8_lossy(&output.stdout);
    print!("{printed}");
    let expected = if wanted.is_empty() { all.len() } else { wanted.len() };
    let wrong = judge(&printed, expected);
    for line in &wrong {
        eprintln!("{line}");
    }
    println!("engine: kani; the seeded faults were not tried");
    Ok(output.status.success() && wrong.is_empty())
}

/// What is wrong with a run: its exit code alone says nothing about what it did not run or reach.
fn judge(printed: &str, expected: usize) -> Vec<String> {
    let mut wrong = Vec::new();
    let summed = printed.lines().rev().find_map(|line| line.strip_prefix("Complete - "));
    let proved = summed.and_then(|line| line.split(' ').next()?.parse::<usize>().ok());
    if proved != Some(expected) {
        wrong.push(format!("kani proved {} harnesses of {expected}", proved.unwrap_or(0)));
    }
    for line in printed.lines() {
        let of_covers =
            line.trim().strip_prefix("** ").filter(|line| line.contains("cover properties"));
        let mut words = of_covers.into_iter().flat_map(|line| line.split(' '));
        if let (Some(reached), Some(all)) = (words.next(), words.nth(1))
            && reached != all
        {
            wrong.push(format!("an unreached cover: {}", line.trim()));
        }
    }
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_harnesses_or_an_unreached_cover_are_wrong() {
        let good = " ** 2 of 2 cover properties satisfied\n\
            Complete - 3 successfully verified harnesses, 0 failures, 3 total.\n";
        assert!(judge(good, 3).is_empty());
        assert_eq!(judge(good, 4).len(), 1);
        assert_eq!(judge(&good.replace("2 of 2", "1 of 2"), 3).len(), 1);
        assert_eq!(judge("No proof harnesses were found.", 3).len(), 1);
    }
}
