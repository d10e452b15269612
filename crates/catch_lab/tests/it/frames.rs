//! Monogram notation, checked: in a product of poses the inner frames agree, and the outer ones are the
//! result's.

use crate::source::{read, rust_files};

#[test]
fn frames_cancel() {
    let mut faults = Vec::new();
    for file in rust_files("crates").iter().filter(|file| !file.ends_with("it/frames.rs")) {
        let text = read(file);
        let lines = text.lines().enumerate();
        let found =
            lines.filter_map(|(i, line)| first_fault(line).map(|it| format!("{}:{}: {it}", file.display(), i + 1)));
        faults.extend(found);
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn right_is_known_from_wrong() {
    for right in [
        "let X_WG = X_WO * X_OG;",
        "let p_WC = X_WO * p_OC;",
        "let X_WO = X_WG * X_OG.inverse();",
        "let X_GO = X_WG.inverse() * X_WO;",
        "let R_GO = R_WG.transpose() * R_WO;",
        "let I_W = R_WL.matrix() * I_L * R_WL.matrix().transpose();",
        "let X_WO = (X_WG[3] * &joint.X_GL) * X_LO;",
        "x = 2.0 * p_WO;",
        "let X_GO = X_WG.inv_mul(&X_WO);",
        "let p_GO = X_WG.inverse_transform_point(&p_WO);",
    ] {
        assert_eq!(first_fault(right), None, "{right}");
    }
    for wrong in [
        "let X_WG = X_WO * X_GO;",
        "let X_WG = X_WO * X_OC * X_GO;",
        "let X_GO = X_WG * X_WO;",
        "let X_GW = X_WG.inverse().inverse() * X_WG;",
        "let R_GO = R_WG * R_WO.transpose();",
        "let p_W = body.X_WG * p_WO;",
        "let X_GW = X_WO * X_OG;",
        "let X_GO = X_GW.inv_mul(&X_WO);",
        "let p_GO = X_GW.inverse_transform_point(&p_WO);",
    ] {
        assert!(first_fault(wrong).is_some(), "{wrong}");
    }
}

/// The first product in a line whose frames do not agree.
fn first_fault(line: &str) -> Option<String> {
    let code = line.split("//").next()?;
    let fault = |what: &str| Some(format!("{what}: {}", code.trim()));
    // `a.f(&b)` is the product of the inverse of `a` and `b` for these.
    for method in [".inv_mul(", ".inverse_transform_point(", ".inverse_transform_vector("] {
        for (at, _) in code.match_indices(method) {
            let (left, right) = (frames(last_operand(&code[..at])), frames(first_operand(&code[at + method.len()..])));
            if left.zip(right).is_some_and(|((outer, _), (inner, _))| outer != inner) {
                return fault("frames do not cancel");
            }
        }
    }
    let factors: Vec<&str> = code.split(" * ").collect();
    for pair in factors.windows(2) {
        let (left, right) = (frames(last_operand(pair[0])), frames(first_operand(pair[1])));
        if left.zip(right).is_some_and(|((_, inner), (outer, _))| inner != outer) {
            return fault("frames do not cancel");
        }
    }
    // let X_AC = X_AB * X_BC;
    let (name, product) = code.trim().strip_prefix("let ")?.strip_suffix(';')?.split_once(" = ")?;
    let factors: Option<Vec<(char, char)>> =
        product.split(" * ").map(|factor| frames(factor.trim_start_matches('&'))).collect();
    let ((a, c), factors) = (frames(name)?, factors?);
    let agrees = factors.first()?.0 == a && factors.last()?.1 == c;
    if agrees || factors.len() < 2 { None } else { fault("the result has other frames") }
}

/// The operand that a text ends with: a path with its indices and calls.
fn last_operand(text: &str) -> &str {
    let text = text.trim_end();
    let mut depth = 0;
    let start = text.char_indices().rev().find(|&(_, letter)| match letter {
        ')' | ']' => {
            depth += 1;
            false
        }
        '(' | '[' => {
            depth -= 1;
            depth < 0
        }
        _ => depth == 0 && !(letter.is_alphanumeric() || letter == '_' || letter == '.'),
    });
    &text[start.map_or(0, |(at, letter)| at + letter.len_utf8())..]
}

/// The operand that a text begins with.
fn first_operand(text: &str) -> &str {
    let text = text.trim_start_matches([' ', '&', '*', '(']);
    let mut depth = 0;
    let end = text.char_indices().find(|&(_, letter)| match letter {
        '(' | '[' => {
            depth += 1;
            false
        }
        ')' | ']' => {
            depth -= 1;
            depth < 0
        }
        _ => depth == 0 && !(letter.is_alphanumeric() || letter == '_' || letter == '.'),
    });
    &text[..end.map_or(text.len(), |(at, _)| at)]
}

/// `X_AB` → (A, B), `X_AB.inverse()` → (B, A), `arm.X_AB.rotation` → (A, B); anything else → `None`, so also
/// `X_WL[i]`, whose L depends on the index.
fn frames(operand: &str) -> Option<(char, char)> {
    let mut found = None;
    for part in operand.split('.') {
        let name = part.split('(').next()?;
        match name {
            "inverse" | "transpose" => found = found.map(|(a, b)| (b, a)),
            "rotation" | "matrix" | "clone" | "to_rotation_matrix" | "to_homogeneous" => {}
            _ => found = monogram(name),
        }
    }
    found
}

fn monogram(name: &str) -> Option<(char, char)> {
    let (quantity, frames) = name.split_once('_')?;
    let &[a, b] = &frames.chars().collect::<Vec<_>>()[..] else { return None };
    let is_monogram = matches!(quantity, "X" | "R" | "p") && a.is_ascii_uppercase() && b.is_ascii_uppercase();
    is_monogram.then_some((a, b))
}
