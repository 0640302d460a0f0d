//! Numbers on the command line, with errors that say what is expected.

use std::ops::RangeInclusive;

/// Largest seed and count that a TOML integer holds.
pub(crate) const LARGEST: u64 = i64::MAX as u64;

/// Returns what reads a whole number in a range.
pub(crate) fn whole<T: TryFrom<u64>>(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let number = text.trim().parse().ok().filter(|number| range.contains(number));
        number.and_then(|number| T::try_from(number).ok()).ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            if *most >= LARGEST {
                format!("expected a whole number of at least {least}")
            } else {
                format!("expected a whole number from {least} to {most}")
            }
        })
    }
}

/// Reads a number.
pub(crate) fn number(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| "expected a number, such as 0.5".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_number_is_told_in_english() {
        let seed = whole::<u64>(0..=LARGEST);
        assert_eq!((seed("7"), seed("-1")), (Ok(7), Err("expected a whole number of at least 0".to_owned())));
        assert_eq!(whole::<usize>(2..=100)("1"), Err("expected a whole number from 2 to 100".to_owned()));
        assert!(whole::<u8>(0..=1000)("300").is_err() && seed("1.5").is_err() && seed("").is_err());
        assert_eq!((number("-0.5"), number("inf").is_err(), number("x").is_err()), (Ok(-0.5), true, true));
    }
}
