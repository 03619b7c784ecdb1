//! What was probably meant by a name that is not known.

/// The name that is reached with the fewest slips of the hand.
pub(super) fn nearest<'n>(name: &str, names: impl Iterator<Item = &'n str>) -> String {
    let nearest = names.min_by_key(|known| strsim::damerau_levenshtein(name, known));
    nearest.unwrap_or_default().to_owned()
}
