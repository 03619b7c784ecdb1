//! What the tables say is what is known: bounds are marked as such, and hold once they are rounded.

use super::*;

/// The figures between which a cell says that the true one is; `?` says nothing.
fn figures_of(cell: &str, whole: f64) -> (f64, f64) {
    let cell = cell.trim_end_matches(" %").trim_end_matches(" ms").trim_end_matches(" MB");
    let number = |text: &str| text.trim().parse::<f64>().expect("a number");
    match (cell, cell.split_once('–')) {
        ("?", _) => (0.0, whole),
        (_, Some((least, most))) => (number(least), number(most)),
        _ if cell.starts_with('≥') => (number(cell.trim_start_matches('≥')), whole),
        _ if cell.starts_with('≤') => (0.0, number(cell.trim_start_matches('≤'))),
        _ => (number(cell), number(cell)),
    }
}

/// D11.
#[test]
fn a_bound_holds_as_it_is_written_and_only_what_is_known_is_written_as_exact() {
    for messages in [1, 3, 7, 20, 333] {
        for at_least in 0..=messages {
            for at_most in at_least..=messages {
                let cell = in_time(BoundedFigure { at_least, at_most }, messages);
                let (least, most) = figures_of(&cell, 100.0);
                let [of_least, of_most] = [at_least, at_most].map(|it| 100.0 * share(it, messages));
                let case = format!("{at_least} to {at_most} of {messages}: {cell}");
                if at_least == at_most {
                    assert!(
                        (least - of_least).abs() <= 0.051 && least.to_bits() == most.to_bits(),
                        "{case}"
                    );
                } else {
                    assert!(least <= of_least && most >= of_most && most > least, "{case}");
                    assert!(of_least - least < 0.11 && most - of_most < 0.11, "{case}");
                }
                let ap = mean_ap(BoundedFigure { at_least: of_least, at_most: of_most });
                let (least, most) = figures_of(&ap, 100.0);
                assert!(least <= of_least + 0.051 && most >= of_most - 0.051, "{case}: {ap}");
                assert_eq!(at_least == at_most, least.to_bits() == most.to_bits(), "{case}: {ap}");
            }
        }
    }
}

/// D11.
#[test]
fn each_figure_of_a_row_that_is_a_bound_is_marked() {
    let ms = Duration::from_millis;
    for marks in 0..32_u32 {
        let is_bound = |index: u32| marks & (1 << index) != 0;
        let quantile = |index, at| {
            Some(if is_bound(index) { Quantile::AtLeast(at) } else { Quantile::Exactly(at) })
        };
        let policy = PolicyReport {
            policy: "p".to_owned(),
            mean_ap: Some(BoundedFigure::exactly(40.0)),
            in_time: BoundedFigure::exactly(9),
            response_ms: [quantile(0, ms(94)), quantile(1, ms(150)), quantile(2, ms(199))],
            outage_response_ms: quantile(3, ms(500)),
            sent_bytes: 1_240_000,
            sent_is_at_least: is_bound(4),
        };
        assert_eq!(policy.has_bounds(), marks > 0);
        let figures = ["94 ms", "150 ms", "199 ms", "500 ms", "1.2 MB"].into_iter().zip(0..);
        let figures =
            figures.map(
                |(figure, index)| {
                    if is_bound(index) { format!("≥ {figure}") } else { figure.to_owned() }
                },
            );
        let expected = ["p", "40.0", "90.0 %"].map(ToOwned::to_owned).into_iter().chain(figures);
        assert_eq!(policy.row(10), expected.collect::<Vec<_>>());
    }
}

/// D11: of all messages that came, refused and missed ones too.
#[test]
fn a_source_has_its_share_of_all_messages() {
    let row = |p, forwarded| {
        let mut counts = [0; COLUMNS.len()];
        counts[1] = forwarded;
        RequestRow { p, counts, response: [None; 3] }
    };
    let totals = Totals {
        messages: 40,
        forwarded: 30,
        missed: 3,
        refused: 5,
        open: 2,
        response: [None; 3],
        rows: vec![row(0, 10), row(1, 4), row(2, 16)],
    };
    let table = sources_table(&totals, |row| format!("source {}", row.p)).to_string();
    for (source, share) in [(0, "25.0 %"), (1, "10.0 %"), (2, "40.0 %")] {
        let line = table.lines().find(|line| line.contains(&format!("source {source}")));
        assert!(line.is_some_and(|line| line.contains(share)), "{table}");
    }
    let sentence = MessagesSentence(&totals).to_string();
    assert_eq!(sentence, "40 messages: 30 forwarded, 3 missed, 5 refused, 2 open");
}
