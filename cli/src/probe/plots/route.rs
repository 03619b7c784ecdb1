//! The route, coloured by the round trip.

use plotters::element::{Circle, Rectangle};
use plotters::style::{Color, RGBColor};

use crate::plot::{Axes, Canvas, DRAWN, Plot, TextLine, Theme, canvas};
use crate::probe::plots::places::SlowestPlaces;

/// What the scale goes from and to, in milliseconds.
const SCALE: (f64, f64) = (10.0, 3000.0);

pub(crate) fn plot(places: SlowestPlaces) -> Plot {
    let caption = "The route from above, north is up. A dot has the colour of the slowest round trip there; \
        black or white is a place where a request had no answer, or a pause began.";
    Plot::new("route", caption, move |theme| {
        let words = ("Network probe: route", "The slowest round trip at each place");
        canvas(theme, (840, 720), words, |canvas| {
            keys(theme, canvas);
            let (across, up) = places.half;
            let area = canvas.margin(104, 50, 20, 62);
            let (x_name, y_name) = ("east, m", "north, m");
            let axes = Axes { x: -across..across, y: -up..up, x_name, y_name };
            let mut chart = axes.chart(theme, &area);
            let dots = places.dots().into_iter().map(|(at, ms)| {
                let colour = ms.map_or(theme.ink, |ms| colour(theme, ms));
                Circle::new(at, 4, colour.filled())
            });
            chart.draw_series(dots).expect(DRAWN);
        })
    })
}

fn keys(theme: &Theme, canvas: &Canvas<'_>) {
    let label = TextLine::new(13.0, theme.ink);
    label.right().put(canvas, "up to 10 ms", (122, 84));
    for step in 0..100 {
        let share = f64::from(step) / 100.0;
        let ms = SCALE.0 * (SCALE.1 / SCALE.0).powf(share);
        let x = 132 + step * 2;
        // One over the other, so that no ground shows between them.
        let bar = Rectangle::new([(x, 76), (332, 92)], colour(theme, ms).filled());
        canvas.draw(&bar).expect(DRAWN);
    }
    label.put(canvas, "3 s or more", (342, 84));
    canvas.draw(&Circle::new((450, 84), 4, theme.ink.filled())).expect(DRAWN);
    label.put(canvas, "no answer, or a pause began", (462, 84));
}

/// From good over orange to bad, by the logarithm.
fn colour(theme: &Theme, ms: f64) -> RGBColor {
    let share = (ms.max(SCALE.0) / SCALE.0).log10() / (SCALE.1 / SCALE.0).log10();
    let share = share.clamp(0.0, 1.0) * 2.0;
    let middle = theme.series[2];
    if share < 1.0 {
        between(theme.good, middle, share)
    } else {
        between(middle, theme.bad, share - 1.0)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
fn between(from: RGBColor, to: RGBColor, share: f64) -> RGBColor {
    let mix = |from: u8, to: u8| {
        (f64::from(to) - f64::from(from)).mul_add(share, f64::from(from)).round() as u8
    };
    RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
}
