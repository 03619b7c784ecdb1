//! Plays scenarios with the options that a user gives, and checks what the book says of them.

use std::collections::BTreeSet;
use std::fs;
use std::io::BufReader;
use std::path::Path;

use anstream::StripStream;
use clap::Parser;
use fuseline_evaluation::{Args, play};
use fuseline_traces::judge;
use png::Decoder;
use serde_json::Value;

const CHAPTER: &str = include_str!("../../docs/book/src/use/scenarios.md");

/// Asserts that the chapter has this row.
fn assert_row<T: AsRef<str>>(name: &str, cells: impl IntoIterator<Item = T>) {
    let row =
        cells.into_iter().fold(format!("| {name} |"), |row, cell| row + " " + cell.as_ref() + " |");
    assert!(CHAPTER.contains(&format!("\n{row}\n")), "the chapter on scenarios lacks {row}");
}

#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    args: Args,
}

/// Plays a scenario and returns its words without colours.
fn scenario(args: &[&str]) -> String {
    let cli = Cli::parse_from(["scenario"].iter().chain(args));
    let mut out = StripStream::new(Vec::new());
    play(&cli.args, &mut out).unwrap();
    String::from_utf8(out.into_inner()).unwrap()
}

fn json(args: &[&str]) -> Value {
    let text = scenario(&[args, &["--json"]].concat());
    assert_eq!(text.lines().count(), 1, "one object");
    serde_json::from_str(&text).unwrap()
}

/// Returns each row's values for these keys.
fn printed<'a>(rows: &'a Value, keys: &[&str]) -> Vec<Vec<&'a Value>> {
    let rows = rows.as_array().unwrap();
    rows.iter().map(|row| keys.iter().map(|key| &row[*key]).collect()).collect()
}

/// Counts the traces in a folder. The strict judge must accept each of them.
fn traces(folder: &Path) -> usize {
    let files = fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
    let judged = files.map(|file| {
        let verdict = judge("trace", &fs::read(&file).unwrap()[..]).unwrap();
        assert!(verdict.violations.is_empty() && verdict.judged > 0, "{}", file.display());
    });
    judged.count()
}

const JAM: [&str; 2] = ["traffic-jam", "--cells-only"];

#[test]
fn traffic_jam_reports_cells_with_parameters() {
    let printed = json(&[&JAM[..], &["--speed", "11,22", "--response", "750ms,1s"]].concat());
    assert_eq!(printed["scenario"], "traffic-jam");
    assert_eq!(printed["parameters"]["vehicle"]["deceleration"], 7.5);
    let cells = printed["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 12);
    let ours = &cells[10];
    assert_eq!((&ours["speed"], &ours["approach"]), (&22.0.into(), &"ours".into()));
    assert_eq!((&ours["outcome"], &ours["response"]), (&"avoids".into(), &0.75.into()));
    assert!((ours["deadline"].as_f64().unwrap() - 0.9192).abs() < 5e-5);
    assert!(ours["impact"].is_null() && ours["gap"][0].as_f64().unwrap() > 3.0);
    let late = &cells[11];
    assert!(late["gap"].is_null() && late["impact"][1].as_f64().unwrap() > 16.0);
}

#[test]
fn a_changed_parameter_shows_at_once() {
    let plain = scenario(&[&JAM[..], &["--json"]].concat());
    assert_eq!(plain, scenario(&[&JAM[..], &["--json"]].concat()), "equal inputs, equal bytes");
    for change in [
        ["--deceleration", "6.5"],
        ["--brake-delay", "300ms"],
        ["--rate", "10"],
        ["--frames", "6"],
        ["--range-local", "45"],
        ["--range-cloud", "50"],
        ["--local-response", "450ms"],
        ["--reveal", "40"],
        ["--deadline", "500ms"],
        ["--deadline", "expected"],
    ] {
        let changed = json(&[&JAM[..], &change].concat());
        let plain: Value = serde_json::from_str(&plain).unwrap();
        // With the expected deadline, the same cells avoid collisions, but impacts are gentler.
        let key = if change[1] == "expected" { "impact" } else { "outcome" };
        assert_ne!(
            printed(&changed["cells"], &[key]),
            printed(&plain["cells"], &[key]),
            "{change:?}"
        );
        for cell in changed["cells"].as_array().unwrap() {
            let outcome = match (cell["gap"].is_null(), cell["impact"].is_null()) {
                (false, true) => "avoids",
                (true, false) => "collides",
                (false, false) => "mixed",
                (true, true) => panic!("{cell}"),
            };
            assert_eq!(cell["outcome"], outcome, "{change:?}");
        }
    }
}

#[test]
fn what_runs_leave_is_accepted_by_the_strict_judge() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let jam = at("jam");
    scenario(&[&JAM[..], &["--speed", "22", "--response", "750ms,1s", "--trace", &jam]].concat());
    assert_eq!(traces(Path::new(&jam)), 3 * 2 * 8);
    let red = at("red");
    scenario(&["red-light", "--delta", "0s", "--round-trip", "68ms", "--trace", &red]);
    assert_eq!(traces(Path::new(&red)), 3 * (1 + 1 + 2));
    let walk = at("walk");
    scenario(&["jaywalking", "--trace", &walk]);
    assert_eq!(traces(Path::new(&walk)), 6);
    let networks = at("networks");
    let few = ["--drive", "cicv5g/rural_n8_v10", "--speed", "20", "--starts", "3"];
    scenario(&[&["networks", "--trace", &networks], &few[..]].concat());
    assert_eq!(traces(Path::new(&networks)), 7 * 3);
}

#[test]
fn no_detector_sees_the_runner_in_time_and_shared_locations_do() {
    let printed = json(&["red-light"]);
    let runs = printed["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 3 * 5 * 7);
    for run in runs {
        let is_shared = run["approach"] == "sharing" && run["round_trip"].as_f64().unwrap() < 0.5;
        assert_eq!(run["collides"], !is_shared, "{run}");
    }
    let brakes: Vec<f64> = runs
        .iter()
        .filter(|run| run["delta"] == 0.0 && run["approach"] == "sharing")
        .filter(|run| run["round_trip"] == 0.068)
        .map(|run| run["brakes_before"].as_f64().unwrap())
        .collect();
    for (found, expected) in brakes.iter().zip([1.93, 2.13, 2.03]) {
        assert!((found - expected).abs() < 0.005, "{brakes:?}");
    }
    let collides =
        |runs: &Value| runs.as_array().unwrap().iter().any(|run| run["collides"] == true);
    assert!(!collides(&printed["without_occluder"]));
    assert!(printed["at_once"].as_array().unwrap().iter().all(|run| run["collides"] == true));
    let open = json(&["red-light", "--no-occluder", "--round-trip", "68ms"]);
    assert!(!collides(&open["runs"]));
    let slow = json(&["red-light", "--runner-speed", "4", "--delta", "0s"]);
    assert_ne!(slow["runs"], printed["runs"]);
}

#[test]
fn only_a_cached_plan_is_fast_enough_for_the_person() {
    let printed = json(&["jaywalking"]);
    let greatest = printed["greatest"].as_array().unwrap();
    for (row, expected) in greatest.iter().zip([[0.5, 8.12, 8.88], [0.4, 9.44, 9.43]]) {
        for (key, expected) in ["response", "swerve", "brake"].iter().zip(expected) {
            let found = row[*key].as_f64().unwrap();
            assert!((found - expected).abs() < 0.005, "{key}: {found}");
        }
    }
    let runs = printed["runs"].as_array().unwrap();
    for run in runs {
        assert_eq!(run["collides"], run["cloud"] != "in-time", "{run}");
    }
    let quicker = json(&["jaywalking", "--steering-rate", "1"]);
    assert_ne!(quicker["greatest"], printed["greatest"]);
    let near = json(&["jaywalking", "--distance", "8"]);
    assert_ne!(near["greatest"], printed["greatest"]);
    let row = |name, printed: &Value, key: &str| {
        let greatest = printed["greatest"].as_array().unwrap().iter();
        assert_row(name, greatest.map(|row| format!("{:.2}", row[key].as_f64().unwrap())));
    };
    row("swerve, 0.4 rad/s: the default", &printed, "swerve");
    row("swerve, `--steering-rate 1`", &quicker, "swerve");
    row("brake", &printed, "brake");
}

#[test]
fn plans_likeliest_hypothesis_first() {
    let all = ["jaywalking", "--hypothesis", "door=0.1,car=0.4,cyclist=0.2,person=0.3"];
    let printed = json(&all);
    let rows = printed["hypotheses"].as_array().unwrap();
    let names: Vec<&Value> = rows.iter().map(|row| &row["name"]).collect();
    assert_eq!(names, ["car", "person", "cyclist", "door"]);
    let cached: Vec<&Value> = rows.iter().map(|row| &row["cached"]).collect();
    assert_eq!(cached, [true, true, true, false]);
    let text = scenario(&all);
    assert!(text.ends_with("The mean response by probability is 0.410 s.\n"), "{text}");
}

#[test]
fn book_has_the_rows_of_recorded_networks() {
    // Playing all twenty speeds takes ten seconds, so only the full tier does it.
    let is_full = std::env::var("FUSELINE_TIER").is_ok_and(|tier| tier == "full");
    let speeds: &[&str] = if is_full { &[] } else { &["--speed", "20,22"] };
    let text = scenario(&[&["networks"], speeds].concat());
    // The first table has the collisions, and the second has the impact energy.
    let row = |start: &str, table: usize| {
        let row = text.lines().filter_map(|line| line.strip_prefix(start)).nth(table);
        row.unwrap().split_whitespace()
    };
    for speed in ["20", "22"] {
        let cells = row(&format!("{speed} m/s"), 0);
        assert_row(speed, cells.map(|cell| cell.trim_end_matches(".0")));
    }
    if is_full {
        assert_row("mean, 11 to 30", row("mean", 0));
        assert_row("impact energy, m²/s²", row("mean", 1));
    }
}

#[test]
fn plots_and_a_page_are_left_whole_and_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let red: &[&str] = &["red-light", "--variant", "skewed", "--delta", "0s"];
    for (args, plots) in [
        (red, &["skewed"][..]),
        (&["jaywalking"], &["greatest-speed"]),
        (&["networks", "--starts", "2", "--speed", "20,22"], &["collisions", "impact"]),
        // The rate is low, because finding the deadlines takes many runs.
        (&[&JAM[..], &["--speed", "22", "--rate", "2"]].concat(), &["deadlines"]),
    ] {
        let [one, two] = ["one", "two"].map(|time| at(&format!("{time}-{}", args[0])));
        let text = scenario(&[args, &["-o", &one]].concat());
        assert!(text.ends_with(&format!("\n{one}/index.html: the page\n")), "{text}");
        // Only one scenario is drawn twice, because drawing takes long.
        if args == red {
            let printed = json(&[args, &["-o", &two]].concat());
            assert_eq!(printed["page"], format!("{two}/index.html"));
        }
        let page = fs::read_to_string(Path::new(&one).join("index.html")).unwrap();
        // Each plot stands on the page on both grounds.
        assert_eq!(page.matches("<svg").count(), 2 * plots.len(), "{args:?}");
        let page = page.replace("http://www.w3.org/2000/svg", "");
        let outside = ["src=", "href=", "url(", "@import", "http:", "https:"];
        assert!(outside.iter().all(|outside| !page.contains(outside)), "{args:?}");
        for name in plots.iter().flat_map(|name| [(*name).to_owned(), format!("{name}-dark")]) {
            let svg = fs::read_to_string(Path::new(&one).join(format!("{name}.svg"))).unwrap();
            let [width, height] = ["width", "height"].map(|side| length(&svg, side));
            assert!(width > 500 && height > 200, "{name}: {width} by {height}");
            let png = fs::File::open(Path::new(&one).join(format!("{name}.png"))).unwrap();
            let mut picture = Decoder::new(BufReader::new(png)).read_info().unwrap();
            let mut pixels = vec![0; picture.output_buffer_size().unwrap()];
            let info = picture.next_frame(&mut pixels).unwrap();
            assert_eq!((info.width, info.height), (2 * width, 2 * height));
            let colours: BTreeSet<&[u8]> = pixels.chunks(3).step_by(61).collect();
            assert!(colours.len() > 5, "{name}: {} colours", colours.len());
        }
        assert_eq!(fs::read_dir(&one).unwrap().count(), 4 * plots.len() + 1, "{args:?}");
        for file in fs::read_dir(&one).unwrap().filter(|_| args == red) {
            let file = file.unwrap();
            let other = fs::read(Path::new(&two).join(file.file_name())).unwrap();
            assert!(fs::read(file.path()).unwrap() == other, "{:?}", file.file_name());
        }
    }
}

/// Returns the length of a side of an SVG.
fn length(svg: &str, side: &str) -> u32 {
    let (_, rest) = svg.split_once(&format!("{side}=\"")).unwrap();
    rest.split('"').next().unwrap().parse().unwrap()
}

#[test]
fn book_has_the_table_of_the_traffic_jam() {
    let markdown = scenario(&[&JAM[..], &["--markdown"]].concat());
    let (table, _) = markdown.split_once("\n\n").unwrap();
    assert_eq!(table.lines().count(), 2 + 15, "{table}");
    assert!(CHAPTER.contains(&format!("\n\n{table}\n\n")), "the chapter lacks {table}");
}

#[test]
fn pipe_in_a_name_keeps_the_markdown_table() {
    let markdown = scenario(&["jaywalking", "--hypothesis", "a|b=0.1", "--markdown"]);
    assert!(markdown.contains("\n| a\\|b | 0.1 | cached | 0.400 s |\n"), "{markdown}");
}

#[test]
fn tables_stand_beside_the_papers_and_without_colours_in_a_pipe() {
    for (args, part) in [
        (&JAM[..], "90 of the 90 cells"),
        (&JAM[..], "Fitted: --deceleration, --brake-delay, --range-local, --range-cloud"),
        (&["red-light"], "0 of 30 runs with a detector would collide"),
        (&["jaywalking"], "above 8.12 up to 9.44 m/s"),
        (&["arbitrage"], "Humans react in 390 to 1200 ms."),
        (&["networks", "--starts", "2", "--speed", "20,22"], "Means over 10 recorded drives"),
    ] {
        let text = scenario(args);
        assert!(text.contains(part), "{text}");
        assert!(!text.contains('\u{1b}'), "no colours");
        let widest = text.lines().map(|line| line.chars().count()).max();
        assert!(widest <= Some(80), "{widest:?}");
    }
}

/// A field has the same type, whatever was chosen.
#[test]
fn policies_and_deadlines_are_texts_in_json() {
    let policies = ["networks", "--starts", "1", "--speed", "20", "--policy", "local,500ms,guard"];
    let played = json(&[&policies[..], &["--drive", "cicv5g/rural_n8_v10"]].concat());
    let rows = printed(&played["rows"], &["policy"]);
    assert_eq!(rows.concat(), ["local", "0.5", "guard"]);
    for (deadline, shown) in [("guard", "guard"), ("500ms", "0.5")] {
        let played = json(&[&JAM[..], &["--speed", "20", "--deadline", deadline]].concat());
        assert_eq!(played["parameters"]["deadline"], shown, "{}", played["parameters"]);
    }
}

#[test]
fn networks_of_a_narrow_link_collide_more_often() {
    let few = ["networks", "--drive", "cicv5g/urban_n78_v40", "--speed", "22", "--starts", "8"];
    let cloud = |more: &[&str]| {
        let printed = json(&[&few[..], &["--policy", "cloud"], more].concat());
        printed["rows"][0]["collisions"].as_u64().unwrap()
    };
    assert_eq!(cloud(&[]), 0);
    assert_eq!(cloud(&["--uplink", "100", "--downlink", "100"]), 0);
    assert_eq!(cloud(&["--uplink", "5"]), 8, "30 frames a second are 8 Mbit/s");
}
