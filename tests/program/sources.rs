//! The library's sources as syntax trees: the files, and the names each defines, re-exports and uses.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};

/// Every source file of the library and the program, by path below the project.
pub fn files() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut found, mut pending) = (Vec::new(), vec![root.join("src")]);
    while let Some(folder) = pending.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                pending.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path.strip_prefix(root).unwrap().to_path_buf());
            }
        }
    }
    found.sort();
    found
}

/// A file's text.
pub fn text(file: &Path) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap()
}

/// Functions longer than `max_lines`, comments and blank lines included: (name, lines).
pub fn long_functions(text: &str, max_lines: usize) -> Vec<(String, usize)> {
    struct Long(usize, Vec<(String, usize)>);
    impl Long {
        /// Counts from `fn` to the closing brace, without the doc comment above.
        fn measure(&mut self, sig: &syn::Signature, block: &syn::Block) {
            let lines = block.brace_token.span.close().end().line - sig.fn_token.span.start().line + 1;
            if lines > self.0 {
                self.1.push((sig.ident.to_string(), lines));
            }
        }
    }
    impl<'a> Visit<'a> for Long {
        fn visit_item_fn(&mut self, f: &'a syn::ItemFn) {
            self.measure(&f.sig, &f.block);
            visit::visit_item_fn(self, f);
        }
        fn visit_impl_item_fn(&mut self, f: &'a syn::ImplItemFn) {
            self.measure(&f.sig, &f.block);
            visit::visit_impl_item_fn(self, f);
        }
    }
    let mut long = Long(max_lines, Vec::new());
    long.visit_file(&syn::parse_file(text).unwrap());
    long.1
}

/// Imports between files: `a -> b` where `a` uses an item that `b` defines. Names are resolved through `pub use` to
/// the file that defines them. Test modules are skipped; methods, which no path names, are not counted.
pub fn imports(sources: &BTreeMap<Vec<String>, (PathBuf, String)>) -> BTreeMap<PathBuf, BTreeSet<PathBuf>> {
    let modules: BTreeMap<_, _> =
        sources.iter().map(|(m, (file, text))| (m.clone(), Module::of(file, text))).collect();
    modules.iter().map(|(at, module)| (module.file.clone(), targets(&modules, at, module))).collect()
}

/// The library's sources by module path: `crate` is `[]`.
pub fn library() -> BTreeMap<Vec<String>, (PathBuf, String)> {
    let module = |file: &Path| -> Vec<String> {
        let below = file.strip_prefix("src").unwrap().with_extension("");
        let mut path: Vec<String> = below.iter().map(|s| s.to_string_lossy().into_owned()).collect();
        if path.last().is_some_and(|l| l == "mod" || l == "lib") {
            path.pop();
        }
        path
    };
    files().into_iter().map(|file| (module(&file), (file.clone(), text(&file)))).collect()
}

/// Groups of files that import each other, each sorted.
pub fn import_cycles(imports: &BTreeMap<PathBuf, BTreeSet<PathBuf>>) -> Vec<Vec<PathBuf>> {
    let reach = |from: &PathBuf| -> BTreeSet<PathBuf> {
        let (mut seen, mut pending) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(at) = pending.pop() {
            for to in imports.get(&at).into_iter().flatten() {
                if seen.insert(to.clone()) {
                    pending.push(to.clone());
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&PathBuf, BTreeSet<PathBuf>> = imports.keys().map(|f| (f, reach(f))).collect();
    let mut found = BTreeSet::new();
    for (file, to) in &reached {
        if to.contains(*file) {
            let mutual = to.iter().filter(|o| reached.get(o).is_some_and(|back| back.contains(*file)));
            found.insert(mutual.cloned().collect::<Vec<_>>());
        }
    }
    found.into_iter().collect()
}

/// The names that a file defines, re-exports and uses.
struct Module {
    file: PathBuf,
    defines: BTreeSet<String>,
    /// `pub use`: name -> path; a glob under `*` with its place.
    reexports: Vec<(String, Vec<String>)>,
    /// `use`: name -> path.
    imports: Vec<(String, Vec<String>)>,
    /// Every other path of at least two segments.
    paths: Vec<Vec<String>>,
}

impl Module {
    fn of(file: &Path, text: &str) -> Module {
        let tree = syn::parse_file(text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let mut module = Module {
            file: file.to_path_buf(),
            defines: BTreeSet::new(),
            reexports: Vec::new(),
            imports: Vec::new(),
            paths: Vec::new(),
        };
        for item in &tree.items {
            if let Some(name) = name_of(item) {
                module.defines.insert(name);
            }
        }
        module.visit_file(&tree);
        module
    }
}

/// An item's name, if a path can end in it.
fn name_of(item: &syn::Item) -> Option<String> {
    use syn::Item::*;
    let name = match item {
        Const(i) => &i.ident,
        Enum(i) => &i.ident,
        Fn(i) => &i.sig.ident,
        Static(i) => &i.ident,
        Struct(i) => &i.ident,
        Trait(i) => &i.ident,
        TraitAlias(i) => &i.ident,
        Type(i) => &i.ident,
        Union(i) => &i.ident,
        Macro(i) => i.ident.as_ref()?,
        Mod(i) if i.content.is_some() => &i.ident,
        _ => return None,
    };
    Some(name.to_string())
}

impl<'a> Visit<'a> for Module {
    fn visit_item(&mut self, item: &'a syn::Item) {
        let attributes = match item {
            syn::Item::Mod(i) => &i.attrs,
            syn::Item::Fn(i) => &i.attrs,
            syn::Item::Use(i) => &i.attrs,
            _ => return visit::visit_item(self, item),
        };
        let for_tests = attributes.iter().any(|a| {
            a.path().is_ident("cfg") && a.parse_args::<syn::Path>().is_ok_and(|p| p.is_ident("test"))
        });
        if !for_tests {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        let mut leaves = Vec::new();
        flatten(&item.tree, &mut Vec::new(), &mut leaves);
        let private = matches!(item.vis, syn::Visibility::Inherited);
        if private { self.imports.extend(leaves) } else { self.reexports.extend(leaves) }
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        self.paths.push(path.segments.iter().map(|s| s.ident.to_string()).collect());
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, mac: &'a syn::Macro) {
        // A macro's arguments have no syntax tree; paths are read from its tokens.
        self.paths.extend(paths_in(mac.tokens.clone()));
        visit::visit_macro(self, mac);
    }
}

/// Leaves of a `use` tree: (name, path).
fn flatten(tree: &syn::UseTree, at: &mut Vec<String>, leaves: &mut Vec<(String, Vec<String>)>) {
    match tree {
        syn::UseTree::Path(p) => {
            at.push(p.ident.to_string());
            flatten(&p.tree, at, leaves);
            at.pop();
        }
        syn::UseTree::Group(g) => g.items.iter().for_each(|t| flatten(t, at, leaves)),
        syn::UseTree::Glob(_) => leaves.push(("*".into(), at.clone())),
        syn::UseTree::Name(n) if n.ident == "self" => {
            leaves.push((at.last().cloned().unwrap_or_default(), at.clone()));
        }
        syn::UseTree::Name(n) => {
            leaves.push((n.ident.to_string(), [&at[..], &[n.ident.to_string()]].concat()))
        }
        syn::UseTree::Rename(r) => {
            let path =
                if r.ident == "self" { at.clone() } else { [&at[..], &[r.ident.to_string()]].concat() };
            leaves.push((r.rename.to_string(), path));
        }
    }
}

/// `a::b::c` in a stream of tokens.
fn paths_in(tokens: proc_macro2::TokenStream) -> Vec<Vec<String>> {
    use proc_macro2::TokenTree;
    let (mut found, mut path, mut colons) = (Vec::new(), Vec::<String>::new(), 0);
    for token in tokens {
        match token {
            TokenTree::Ident(ident) => {
                if colons != 2 {
                    found.push(std::mem::take(&mut path));
                }
                path.push(ident.to_string());
                colons = 0;
            }
            TokenTree::Punct(p) if p.as_char() == ':' => colons += 1,
            TokenTree::Group(group) => {
                found.extend(paths_in(group.stream()));
                colons = 0;
            }
            _ => colons = 0,
        }
    }
    found.push(path);
    found.retain(|p| !p.is_empty());
    found
}

/// The files that a module's imports and paths refer to.
fn targets(modules: &BTreeMap<Vec<String>, Module>, at: &[String], module: &Module) -> BTreeSet<PathBuf> {
    let imported: BTreeMap<&String, &Vec<String>> = module.imports.iter().map(|(n, p)| (n, p)).collect();
    let expanded = module.paths.iter().map(|path| match imported.get(&path[0]) {
        Some(start) => [&start[..], &path[1..]].concat(),
        None => path.clone(),
    });
    let named = module.imports.iter().map(|(_, path)| path.clone()).chain(expanded);
    let found = named.filter_map(|path| {
        let path = absolute(modules, at, &path)?;
        resolve(modules, &path, 0)
    });
    found.filter(|file| *file != module.file).collect()
}

/// The path from the crate's root, if it is a path of this crate.
fn absolute(modules: &BTreeMap<Vec<String>, Module>, at: &[String], path: &[String]) -> Option<Vec<String>> {
    let mut base = at.to_vec();
    match path[0].as_str() {
        "crate" | "iplw" => return Some(path[1..].to_vec()),
        "self" => return Some([&base[..], &path[1..]].concat()),
        "super" => {
            let ups = path.iter().take_while(|s| *s == "super").count();
            base.truncate(base.len().checked_sub(ups)?);
            return Some([&base[..], &path[ups..]].concat());
        }
        _ => {}
    }
    base.push(path[0].clone());
    let is_child = path.len() > 1 && modules.contains_key(&base);
    is_child.then(|| [at, path].concat())
}

/// The file that defines the item at a path from the root; `None` for a module itself and for unresolved paths.
fn resolve(modules: &BTreeMap<Vec<String>, Module>, path: &[String], depth: usize) -> Option<PathBuf> {
    if depth > 8 {
        return None;
    }
    let depth_of_module = (0..=path.len()).rev().find(|n| modules.contains_key(&path[..*n]))?;
    let (home, rest) = path.split_at(depth_of_module);
    let module = &modules[home];
    let name = rest.first()?;
    if module.defines.contains(name) {
        return Some(module.file.clone());
    }
    let onward = |start: &Vec<String>, tail: &[String]| {
        let start = absolute(modules, home, start)?;
        resolve(modules, &[&start[..], tail].concat(), depth + 1)
    };
    let by_name = module.reexports.iter().filter(|(n, _)| n == name).find_map(|(_, p)| onward(p, &rest[1..]));
    by_name.or_else(|| module.reexports.iter().filter(|(n, _)| n == "*").find_map(|(_, p)| onward(p, rest)))
}
