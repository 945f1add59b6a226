//! Formulas as they are typed, `L = r_a L_a + sum_j (n . l_j)^m`, as MathML.
//!
//! Greek letters by name; `_` and `^` for indices and powers, `/` for fractions, each of the one item beside it; round brackets around
//! an item of these are left out; `sqrt(x)`; prose in quotes. Two spaces separate formulas.

use std::fmt::Write as _;
use std::iter::Peekable;
use std::vec::IntoIter;

use fantex::base::markup_escaped;

/// One `<math>` for each formula of a line.
pub(super) fn mathml(line: &str) -> String {
    let formulas = line.split("  ").map(str::trim).filter(|formula| !formula.is_empty());
    let mut html = String::new();
    for formula in formulas {
        let row = Parser { tokens: tokens(formula).into_iter().peekable() }.row(None);
        writeln!(html, "<math>{row}</math>")
            .unwrap_or_else(|_| unreachable!("writing to a string cannot fail"));
    }
    html
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'t> {
    Number(&'t str),
    Word(&'t str),
    Text(&'t str),
    Operator(&'t str),
}

const WORDS: [(&str, &str); 13] = [
    ("alpha", "α"),
    ("delta", "δ"),
    ("lambda", "λ"),
    ("theta", "θ"),
    ("phi", "φ"),
    ("sigma", "σ"),
    ("pi", "π"),
    ("omega", "ω"),
    ("kappa", "κ"),
    ("Omega", "Ω"),
    ("inf", "∞"),
    ("sum", "∑"),
    ("int", "∫"),
];

const OPERATORS: [(&str, &str); 10] = [
    ("<=", "≤"),
    (">=", "≥"),
    ("<-", "←"),
    ("->", "→"),
    ("...", "…"),
    ("-", "−"),
    (".", "·"),
    ("**", "∗"),
    ("*", "×"),
    ("~", "∝"),
];

fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut found = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let until = |is_part: fn(char) -> bool| rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        let length = match first {
            '"' => rest[1..].find('"').map_or(rest.len(), |end| end + 2),
            '0'..='9' => until(|c| c.is_ascii_digit() || c == '.'),
            _ if first.is_alphabetic() => until(|c| c.is_alphabetic() || c == '\''),
            _ => OPERATORS
                .iter()
                .find(|(name, _)| rest.starts_with(name))
                .map_or(first.len_utf8(), |(name, _)| name.len()),
        };
        let (token, after) = rest.split_at(length);
        found.push(match first {
            '"' => Token::Text(token.trim_matches('"')),
            '0'..='9' => Token::Number(token),
            _ if first.is_alphabetic() => Token::Word(token),
            _ => Token::Operator(token),
        });
        rest = after.trim_start();
    }
    found
}

struct Parser<'t> {
    tokens: Peekable<IntoIter<Token<'t>>>,
}

/// MathML of an item; with the brackets around it, if it has any.
struct Item {
    inner: String,
    is_bracketed: bool,
}

impl Item {
    fn whole(&self) -> String {
        match self.is_bracketed {
            true => format!("<mrow><mo>(</mo>{}<mo>)</mo></mrow>", self.inner),
            false => self.inner.clone(),
        }
    }
}

impl Parser<'_> {
    /// Items up to a closing bracket.
    fn row(&mut self, close: Option<&str>) -> String {
        let mut row = String::new();
        while let Some(&token) = self.tokens.peek() {
            if close.is_some_and(|close| token == Token::Operator(close)) {
                self.tokens.next();
                break;
            }
            let mut item = self.scripted();
            while self.takes("/") {
                let below = self.scripted();
                let inner = format!("<mfrac><mrow>{}</mrow><mrow>{}</mrow></mfrac>", item.inner, below.inner);
                item = Item { inner, is_bracketed: false };
            }
            row.push_str(&item.whole());
        }
        format!("<mrow>{row}</mrow>")
    }

    fn takes(&mut self, operator: &str) -> bool {
        self.tokens.next_if(|token| *token == Token::Operator(operator)).is_some()
    }

    /// An item with its index and its power.
    fn scripted(&mut self) -> Item {
        let base = self.item();
        let below = self.takes("_").then(|| self.item().inner);
        let above = self.takes("^").then(|| self.item().inner);
        let whole = base.whole();
        let inner = match (below, above) {
            (None, None) => return base,
            (Some(below), None) if whole.contains('∑') => format!("<munder>{whole}{below}</munder>"),
            (Some(below), None) => format!("<msub>{whole}{below}</msub>"),
            (None, Some(above)) => format!("<msup>{whole}{above}</msup>"),
            (Some(below), Some(above)) => format!("<msubsup>{whole}{below}{above}</msubsup>"),
        };
        Item { inner, is_bracketed: false }
    }

    fn item(&mut self) -> Item {
        let inner = match self.tokens.next() {
            None => "<mrow></mrow>".to_owned(),
            Some(Token::Operator("(")) => return Item { inner: self.row(Some(")")), is_bracketed: true },
            Some(Token::Word("sqrt")) => format!("<msqrt>{}</msqrt>", self.item().inner),
            Some(Token::Number(number)) => format!("<mn>{number}</mn>"),
            Some(Token::Text(text)) => format!("<mtext>&nbsp;{}&nbsp;</mtext>", markup_escaped(text)),
            Some(Token::Word(word)) => {
                let (name, primes) = word.split_at(word.find('\'').unwrap_or(word.len()));
                let sign = WORDS.iter().find(|(typed, _)| *typed == name).map_or(name, |(_, sign)| *sign);
                let tag = if "∑∫".contains(sign) { "mo" } else { "mi" };
                format!("<{tag}>{sign}{}</{tag}>", "′".repeat(primes.len()))
            }
            Some(Token::Operator(operator)) => {
                let sign = OPERATORS
                    .iter()
                    .find(|(typed, _)| *typed == operator)
                    .map_or(operator, |(_, sign)| *sign);
                // Bars and slashes that are not brackets of a known size stay as they are.
                let fixed = if operator == "|" { " stretchy=\"false\"" } else { "" };
                format!("<mo{fixed}>{}</mo>", markup_escaped(sign))
            }
        };
        Item { inner, is_bracketed: false }
    }
}

#[cfg(test)]
mod tests {
    use super::mathml;

    #[test]
    fn indices_powers_and_fractions_take_the_item_beside_them() {
        assert_eq!(
            mathml("r_a^2 (n . l)/(1 + x)"),
            "<math><mrow><msubsup><mi>r</mi><mi>a</mi><mn>2</mn></msubsup><mfrac><mrow><mrow><mi>n</mi><mo>·</mo><mi>l</mi></mrow></mrow>\
             <mrow><mrow><mn>1</mn><mo>+</mo><mi>x</mi></mrow></mrow></mfrac></mrow></math>\n"
        );
        assert_eq!(mathml("a <= b  \"if\" c < d").matches("<math>").count(), 2);
        assert!(mathml("lambda' (u, v)").contains("<mi>λ′</mi><mrow><mo>(</mo>"));
        assert!(mathml("c < d").contains("<mo>&lt;</mo>"));
    }

    #[test]
    fn nothing_is_too_wrong_to_be_shown() {
        for formula in ["", "(", ")", "a_", "^", "1 / ", "\"open", "sqrt", "((()", "_^/"] {
            assert_eq!(
                mathml(formula).matches("<mrow>").count(),
                mathml(formula).matches("</mrow>").count(),
                "{formula}"
            );
        }
    }
}
