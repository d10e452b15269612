//! The attribute `catch_body::quantity::checked`, which serde reads files' structs by.

use proc_macro::{Delimiter, Group, TokenStream, TokenTree};

/// Takes the place of `#[serde(…)]` above a struct's or enum's derives: each field whose type is
/// `quantity::name`, or `quantity::name<T>`, is read within the range of that quantity. An optional one may
/// be missing, as with serde.
#[proc_macro_attribute]
pub fn checked(arguments: TokenStream, item: TokenStream) -> TokenStream {
    let has_defaults = arguments.to_string().split(',').any(|it| it.trim() == "default");
    let item: Vec<TokenTree> = item.into_iter().collect();
    // Serde's attributes stand after the derive.
    let at = item.chunks(2).take_while(|it| it[0].to_string() == "#").count() * 2;
    let serde: TokenStream = format!("#[serde({arguments})]").parse().unwrap_or_default();
    let rest = item[at..].iter().map(|tree| match tree {
        TokenTree::Group(group) => {
            TokenTree::Group(Group::new(group.delimiter(), fields(group.stream(), has_defaults)))
        }
        tree => tree.clone(),
    });
    item[..at].iter().cloned().chain(serde).chain(rest).collect()
}

/// The fields with the attributes by which serde reads them.
fn fields(stream: TokenStream, has_defaults: bool) -> TokenStream {
    let trees: Vec<TokenTree> = stream.into_iter().collect();
    let mut out = Vec::with_capacity(trees.len());
    let mut field = 0;
    let mut depth = 0;
    for (i, tree) in trees.iter().enumerate() {
        match tree {
            TokenTree::Group(group) if group.delimiter() != Delimiter::Bracket => {
                out.push(TokenTree::Group(Group::new(group.delimiter(), fields(group.stream(), has_defaults))));
                continue;
            }
            TokenTree::Punct(it) if it.as_char() == '<' => depth += 1,
            TokenTree::Punct(it) if it.as_char() == '>' => depth -= 1,
            TokenTree::Ident(it) if it.to_string() == "quantity" => {
                let name = trees.get(i + 3).map(ToString::to_string).unwrap_or_default();
                let is_optional = trees.get(i + 5).is_some_and(|it| it.to_string() == "Option");
                let default = if is_optional && !has_defaults { "default, " } else { "" };
                let serde = format!("#[serde({default}deserialize_with = \"quantity::{name}\")]");
                out.splice(field..field, serde.parse::<TokenStream>().unwrap_or_default());
            }
            _ => {}
        }
        out.push(tree.clone());
        if depth == 0 && tree.to_string() == "," {
            field = out.len();
        }
    }
    out.into_iter().collect()
}
