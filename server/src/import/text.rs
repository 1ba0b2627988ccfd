//! Text habits of programs that write mesh files.

/// The mark that some editors put before a text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// `bytes` without a mark before them.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes)
}

/// Bytes of the mark that `head` begins with.
pub(super) fn mark_bytes(head: &[u8]) -> u64 {
    (head.len() - without_mark(head).len()) as u64
}

/// `line` up to its comment; the `#` of numbers as [`number`] has them begins none.
pub(super) fn before_comment(line: &[u8]) -> &[u8] {
    let begins = |at: &usize| {
        let is_number = line[..*at].ends_with(b"1.")
            && line.get(at + 1).is_some_and(|it| b"INQSinqs".contains(it));
        line[*at] == b'#' && !is_number
    };
    &line[..(0..line.len()).find(begins).unwrap_or(line.len())]
}

/// A number, also one of those that C libraries print for what is none: `-nan(ind)`, `1.#QNAN`.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    let word = std::str::from_utf8(word).ok()?;
    if let Ok(number) = word.parse() {
        return Some(number);
    }
    let bare = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
    let is_none = bare.starts_with("1.#") || bare.starts_with("nan(");
    is_none.then_some(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_c_prints_them() {
        for (word, expected) in [
            ("1.5", Some(1.5)),
            ("+.5e1", Some(5.0)),
            ("456789.123", Some(456_789.123)),
            ("1,5", None),
            ("1.5f", None),
            ("", None),
        ] {
            assert_eq!(number(word.as_bytes()), expected, "{word}");
        }
        for word in ["nan", "-nan(ind)", "-NaN", "1.#QNAN", "-1.#IND00", "1.#INF"] {
            assert!(number(word.as_bytes()).is_some_and(f64::is_nan), "{word}");
        }
        assert_eq!(number(b"\xff"), None);
    }

    #[test]
    fn comments_are_no_numbers() {
        for (line, expected) in [
            ("1 2 3", "1 2 3"),
            ("1 2 3#4", "1 2 3"),
            ("1 2 3 # 1.#IND", "1 2 3 "),
            ("1.#QNAN -1.#IND 1. # 1", "1.#QNAN -1.#IND 1. "),
            ("#", ""),
            ("", ""),
        ] {
            assert_eq!(
                before_comment(line.as_bytes()),
                expected.as_bytes(),
                "{line}"
            );
        }
    }
}
