//! The exit code of `fuseline check` for several files, and what stands where.

use std::fs;
use std::path::Path;

use crate::common::{err, out, run};
use tempfile::tempdir;

/// A file, the exit codes that it leads to, and what is printed about it.
struct CheckedFile {
    name: &'static str,
    text: String,
    /// The exit codes without options, with `--accept unjudged`, with `--truncated`, and as
    /// observed.
    codes: [i32; 4],
}

const OPTIONS: [&[&str]; 4] = [
    &[],
    &["--accept", "unjudged"],
    &["--truncated"],
    &["--observed", "--tolerance", "0s", "--lateness", "0s"],
];

fn files() -> [CheckedFile; 4] {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus");
    let read = |name: &str| fs::read_to_string(corpus.join(name)).unwrap();
    let good = read("f3-forwarded-at-once.jsonl");
    let cut = good.trim_end().to_owned();
    let header = good.lines().next().unwrap().to_owned() + "\n";
    let bad = read("bad/f3-first-response-wins.jsonl");
    [
        CheckedFile { name: "good", text: good, codes: [0; 4] },
        CheckedFile { name: "bad", text: bad, codes: [1; 4] },
        CheckedFile { name: "cut", text: cut, codes: [2, 2, 3, 2] },
        CheckedFile { name: "empty", text: header, codes: [3, 0, 3, 3] },
    ]
}

#[test]
fn the_exit_code_is_the_greatest_of_all_files_whatever_their_order() {
    let (dir, files) = (tempdir().unwrap(), files());
    for CheckedFile { name, text, .. } in &files {
        fs::write(dir.path().join(name), text).unwrap();
    }
    for (option, more) in OPTIONS.iter().enumerate() {
        for first in 0..files.len() {
            for second in 0..files.len() {
                let mut some = vec![&files[first], &files[second]];
                // One file alone, too.
                some.truncate(if first == second { 1 } else { 2 });
                let paths = some.iter().map(|file| dir.path().join(file.name));
                let paths: Vec<String> = paths.map(|path| path.display().to_string()).collect();
                let mut args = [&["check"], *more].concat();
                args.extend(paths.iter().map(String::as_str));
                let checked = run(&args, "");
                let codes = some.iter().map(|file| file.codes[option]);
                // 2 wins over 1, and 1 over 3.
                let worst =
                    codes.max_by_key(|code| [0, 3, 1, 2].iter().position(|other| other == code));
                assert_eq!(checked.status.code(), worst, "{args:?}: {}", err(&checked));
                // Verdicts stand in the order of the files, and of what cannot be read there is one
                // error.
                let of = |file: &&&CheckedFile| file.codes[option] != 2;
                let verdicts = out(&checked).lines().filter(|line| line.contains("judged in"));
                let named = some.iter().filter(of).map(|file| dir.path().join(file.name));
                let named: Vec<String> =
                    named.map(|path| format!("{}: ", path.display())).collect();
                assert_eq!(verdicts.clone().count(), named.len(), "{}", out(&checked));
                assert!(verdicts.zip(&named).all(|(line, name)| line.starts_with(name)));
                let errors = err(&checked).lines().filter(|line| line.starts_with("error: "));
                let of_reading = some.iter().filter(|file| file.codes[option] == 2).count();
                assert_eq!(errors.count(), of_reading, "{}", err(&checked));
            }
        }
    }
}
