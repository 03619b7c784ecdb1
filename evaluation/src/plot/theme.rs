//! The grounds on which plots stand, in the colours of the page of `fuseline report`.

use plotters::style::RGBColor;

/// Colours on one ground.
#[derive(Clone, Copy, Debug)]
pub struct Theme {
    /// The ending of its files' names, before the extension.
    pub suffix: &'static str,
    /// The background.
    pub ground: RGBColor,
    /// Words and axes.
    pub ink: RGBColor,
    /// Words of lesser weight.
    pub soft: RGBColor,
    /// Lines of the grid.
    pub line: RGBColor,
    /// The colour of avoided collisions and of timely results.
    pub good: RGBColor,
    /// The colour of collisions and of late results.
    pub bad: RGBColor,
    /// Lines and bars, one after the other.
    pub series: [RGBColor; 7],
}

const fn colour(rgb: u32) -> RGBColor {
    let [_, red, green, blue] = rgb.to_be_bytes();
    RGBColor(red, green, blue)
}

/// The colours on light ground.
pub const LIGHT: Theme = Theme {
    suffix: "",
    ground: colour(0xff_ff_ff),
    ink: colour(0x1d_25_30),
    soft: colour(0x5d_68_75),
    line: colour(0xe2_e6_eb),
    good: colour(0x1f_7a_4d),
    bad: colour(0xc6_2f_3b),
    series: [
        colour(0x8b_95_a3),
        colour(0x3f_7f_d9),
        colour(0xe0_8a_2c),
        colour(0x2c_9c_8a),
        colour(0x92_64_cc),
        colour(0xc7_56_8f),
        colour(0x7d_9b_2f),
    ],
};

/// The colours on dark ground.
pub const DARK: Theme = Theme {
    suffix: "-dark",
    ground: colour(0x1a_20_27),
    ink: colour(0xe4_e8_ed),
    soft: colour(0x9a_a5_b1),
    line: colour(0x2f_38_42),
    good: colour(0x2f_8f_5f),
    bad: colour(0xc9_48_52),
    series: [
        colour(0x8a_95_a3),
        colour(0x5b_96_ea),
        colour(0xe5_9a_48),
        colour(0x46_b3_a1),
        colour(0xa8_81_dc),
        colour(0xd5_73_a6),
        colour(0x9a_b6_50),
    ],
};
