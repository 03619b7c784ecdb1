//! Cuts lines off at the edges of the visible area. The drawing library would bend them
//! instead.

use std::ops::Range;

type ChartPoint = (f64, f64);

/// Returns the pieces of a line that lie between the edges.
pub(super) fn pieces(line: &[ChartPoint], [x, y]: [&Range<f64>; 2]) -> Vec<Vec<ChartPoint>> {
    let mut pieces: Vec<Vec<ChartPoint>> = Vec::new();
    for pair in line.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let mut part = (0.0, 1.0);
        for (at, by, edges) in [(from.0, to.0 - from.0, x), (from.1, to.1 - from.1, y)] {
            part = between((at, by), edges, part);
        }
        if part.0 > part.1 {
            continue;
        }
        let at = |part: f64| {
            let along = |from: f64, to: f64| from + (to - from) * part;
            // The ends stay exactly the same, so that pieces join.
            if part >= 1.0 { to } else { (along(from.0, to.0), along(from.1, to.1)) }
        };
        let (first, last) = (at(part.0), at(part.1));
        match pieces.last_mut() {
            Some(piece) if piece.last() == Some(&first) => piece.push(last),
            _ => pieces.push(vec![first, last]),
        }
    }
    pieces
}

/// Narrows a part of a line to what lies between two edges. If nothing does, the end of the
/// returned part is before its beginning.
fn between((at, by): ChartPoint, edges: &Range<f64>, (first, last): ChartPoint) -> ChartPoint {
    if by == 0.0 {
        let is_between = (edges.start..=edges.end).contains(&at);
        return if is_between { (first, last) } else { (1.0, 0.0) };
    }
    let [one, other] = [edges.start, edges.end].map(|edge| (edge - at) / by);
    (first.max(one.min(other)), last.min(one.max(other)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_cut_where_it_crosses_an_edge() {
        let line = [(0.0, 0.0), (2.0, 2.0), (4.0, 6.0), (6.0, 2.0), (9.0, 2.0)];
        let cut = pieces(&line, [&(0.0..8.0), &(1.0..4.0)]);
        let remaining = vec![(1.0, 1.0), (2.0, 2.0), (3.0, 4.0)];
        assert_eq!(cut, [remaining, vec![(5.0, 4.0), (6.0, 2.0), (8.0, 2.0)]]);
        assert!(pieces(&line, [&(0.0..8.0), &(7.0..9.0)]).is_empty());
        assert_eq!(pieces(&line, [&(0.0..9.0), &(0.0..6.0)]), [line.to_vec()]);
    }
}
