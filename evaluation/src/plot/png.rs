//! SVG to PNG, with a font of our own: the same bytes on every host.

use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::fontdb::Database;
use resvg::usvg::{Options, Tree};

/// The font's family; `fonts/LICENSE` is its licence.
pub(super) const FONT: &str = "Inter";
/// Pixels for one unit of the drawing.
const SCALE: f32 = 2.0;

static FONTS: LazyLock<Arc<Database>> = LazyLock::new(|| {
    let mut fonts = Database::new();
    fonts.load_font_data(include_bytes!("../../fonts/inter-regular.ttf").to_vec());
    fonts.load_font_data(include_bytes!("../../fonts/inter-semibold.ttf").to_vec());
    fonts.set_sans_serif_family(FONT);
    Arc::new(fonts)
});

/// The picture of a drawing of ours.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a drawing has some hundreds of units"
)]
pub(super) fn png(svg: &str) -> Vec<u8> {
    let options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
    let tree = Tree::from_str(svg, &options).expect("we drew it");
    let size = tree.size();
    let [width, height] = [size.width(), size.height()].map(|side| (side * SCALE).round() as u32);
    let mut pixels = Pixmap::new(width, height).expect("it is not empty");
    resvg::render(&tree, Transform::from_scale(SCALE, SCALE), &mut pixels.as_mut());
    pixels.encode_png().expect("it is in memory")
}
