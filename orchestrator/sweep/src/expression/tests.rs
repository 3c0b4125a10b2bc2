use proptest::prelude::*;

use super::*;

fn value(text: &str) -> f64 {
    let names = ["m", "r", "missing", "vehicle.drag.0"];
    let expression = Expression::parse(text, |name| names.iter().position(|other| *other == name));
    expression.unwrap().value(&[2.0, 3.0, f64::NAN, 5.0])
}

#[test]
fn operators_bind_as_in_mathematics() {
    for (text, expected) in [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("-2 ^ 2", -4.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("2^-1", 0.5),
        ("7 - 2 - 1", 4.0),
        ("8 / 2 / 2", 2.0),
        ("m * r^2", 18.0),
        ("1.5e-1 * 2", 0.3),
        ("max(m, r) - min(m, r)", 1.0),
        ("sqrt(m*m)", 2.0),
        ("m < r and r < 4", 1.0),
        ("m > r or not r == 3", 0.0),
        ("not m > r and m != r", 1.0),
        ("1 < m < r", 1.0),
        ("0.001 < m < 0.5", 0.0),
        ("3 > m < r == 3", 1.0),
        ("not 1 < m < r", 0.0),
        ("vehicle.drag.0*2 < 11", 1.0),
        ("missing < 1 or m < r", 1.0),
        ("missing < 1 and m > r", 0.0),
    ] {
        assert!((value(text) - expected).abs() < 1e-15, "{text}: {}", value(text));
    }
    for missing in [
        "missing + 1",
        "missing != missing",
        "missing < 1 or missing >= 1",
        "not missing > 3",
        "max(missing, 0.1) < 0.5",
        "min(0.1, missing)",
        "missing < 1 and m < r",
        "1 < missing < 3",
        "not (missing < 1 or m > r)",
    ] {
        assert!(value(missing).is_nan(), "{missing}");
    }
}

#[test]
fn an_error_names_its_place() {
    let error = |text| Expression::parse(text, |_| None).unwrap_err();
    for (text, offset, reason) in [
        ("1 +", 3, "a number, a name or a bracket"),
        ("(1", 2, "expected `)`"),
        ("1 2", 2, "expected the end"),
        ("x * 2", 0, "no value `x`"),
        ("tan(1)", 0, "there are abs, cos"),
        ("max(1)", 0, "has 2 arguments, not 1"),
    ] {
        let error = error(text);
        assert_eq!(error.offset, offset, "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}

#[test]
fn depth_and_length_are_bounded_and_long_texts_have_errors() {
    let parse = |text: &str| Expression::parse(text, |_| Some(0));
    let nested =
        |before: &str, after: &str, count: usize| format!("{}1{}", before.repeat(count), after.repeat(count));
    for (before, after) in [("(", ")"), ("-", ""), ("not ", ""), ("2^", ""), ("abs(", ")")] {
        let fine = parse(&nested(before, after, 99)).unwrap();
        let _ = fine.value(&[1.0]);
        for count in [100, 200_000] {
            let error = parse(&nested(before, after, count)).unwrap_err();
            assert!(error.reason.contains("at most 100 deep"), "{before}: {error}");
        }
    }
    let fine = parse(&nested("1+", "", 1000)).unwrap();
    assert!((fine.value(&[]) - 1001.0).abs() < 1e-12);
    assert!(
        parse(&nested("1+", "", 100_000))
            .unwrap_err()
            .reason
            .contains("1000 operators")
    );

    let late = format!("{}x", " ".repeat(70_000));
    let error = Expression::parse(&late, |_| None).unwrap_err().to_string();
    let lines: Vec<_> = error.lines().collect();
    assert_eq!(lines[1].chars().position(|character| character == 'x'), Some(104));
    assert_eq!(lines[2].chars().position(|character| character == '^'), Some(104));
}

#[test]
fn words_of_the_language_are_no_names() {
    assert!(is_name("m") && is_name("_r2") && is_name("order"));
    assert!(!is_name("and") && !is_name("not") && !is_name("2m") && !is_name("a.b") && !is_name(""));
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(text in ".{0,40}", tokens in prop::collection::vec("[-+*/^()<>=!,.0-9a-z ]{1,3}", 0..20)) {
        let _ = Expression::parse(&text, |_| Some(0)).map(|expression| expression.value(&[1.0]));
        let _ = Expression::parse(&tokens.concat(), |_| Some(0)).map(|expression| expression.value(&[1.0]));
    }
}
