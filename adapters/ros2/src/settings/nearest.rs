//! Finds the name that an unknown name was probably meant to be.

/// Returns the name with the fewest typing errors between them.
pub(crate) fn nearest<'n>(name: &str, names: impl Iterator<Item = &'n str>) -> String {
    let nearest = names.min_by_key(|known| strsim::damerau_levenshtein(name, known));
    nearest.unwrap_or_default().to_owned()
}
