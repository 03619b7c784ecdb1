//! What the remedies leave of the cloud over the uplink's rate.

use crate::plot::{Axes, ChartLine, Plot, canvas, logarithmic};
use crate::scenario::link::text::uplinks;
use crate::scenario::link::{DeadlineRule, LinkResult, Remedy};

pub(crate) fn plots(result: &LinkResult) -> Vec<Plot> {
    let uplinks = uplinks(result);
    let (least, most) = uplinks
        .iter()
        .fold((f64::INFINITY, 0.0_f64), |(least, most), at| (least.min(*at), most.max(*at)));
    let x = 10_f64.powf(least.log10().floor())..10_f64.powf(most.log10().ceil()).max(least * 10.0);
    let gates = |remedy| matches!(remedy, Remedy::Gate(limit) if limit > 1);
    let lines: [(&'static str, Vec<(f64, f64)>); 5] = [
        ("none", mean(result, &uplinks, |remedy| remedy == Remedy::None)),
        ("gate by default", mean(result, &uplinks, gates)),
        ("gate 1", mean(result, &uplinks, |remedy| remedy == Remedy::Gate(1))),
        ("every n-th", mean(result, &uplinks, |remedy| remedy == Remedy::EveryNth)),
        ("send budget", mean(result, &uplinks, |remedy| remedy == Remedy::Budget)),
    ];
    let caption = "The share of messages that the cloud answers in time over the uplink's rate, mean of all sizes and rates, \
        by what keeps the queue short.";
    vec![Plot::new("link", caption, move |theme| {
        let words = (
            "A link with a width",
            "Messages answered by the cloud in time, mean over sizes and rates",
        );
        canvas(theme, (860, 470), words, |canvas| {
            let colours = theme.series.iter().copied();
            let line = |((name, points), colour): (&(&str, Vec<_>), _)| ChartLine {
                name: (*name).to_owned(),
                colour,
                width: 3,
                is_dashed: false,
                points: points.clone(),
            };
            let lines: Vec<ChartLine> = lines.iter().zip(colours).map(line).collect();
            ChartLine::keys(&lines, theme, canvas, (82, 84));
            let area = canvas.margin(104, 12, 20, 24);
            let axes = Axes {
                x: x.clone(),
                y: 0.0..105.0,
                x_name: "uplink, Mbit/s",
                y_name: "by the cloud, %",
            };
            let mut chart = axes.scaled(theme, &area, (logarithmic(&axes.x), axes.y.clone()));
            for line in &lines {
                line.draw(&mut chart, &axes);
            }
        })
    })]
}

fn mean(
    result: &LinkResult,
    uplinks: &[f64],
    is_meant: impl Fn(Remedy) -> bool,
) -> Vec<(f64, f64)> {
    let of = |uplink: &f64| {
        let rows = result.rows.iter().filter(|row| {
            row.policy == DeadlineRule::Constant
                && is_meant(row.remedy)
                && row.uplink_mbps.total_cmp(uplink).is_eq()
        });
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for row in rows {
            sum += row.by_cloud * 100.0;
            count += 1.0;
        }
        (*uplink, sum / count.max(1.0))
    };
    uplinks.iter().map(of).collect()
}
