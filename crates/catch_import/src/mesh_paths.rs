//! Finds the files of meshes that descriptions of robots name.

use std::path::{Component, Path, PathBuf};

/// Folders above a description in which a package is looked for.
const MOST_FOLDERS_UP: usize = 12;

/// The file that `named` means in the description `file`: `package://PACKAGE/PATH`, `model://…`,
/// `file://PATH`, or a path relative to the description.
///
/// A package is the nearest folder of its name, or the nearest with a `package.xml` that names it, among the
/// folders above the description and those beside them.
pub fn resolve(file: &Path, named: &str) -> Option<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let folder = std::fs::canonicalize(folder).ok()?;
    if let Some(path) = named.strip_prefix("file://") {
        return existing(folder.join(path));
    }
    let Some(path) = ["package://", "model://"].iter().find_map(|it| named.strip_prefix(it)) else {
        return existing(folder.join(named)).or_else(|| below_some_folder(&folder, Path::new(named)));
    };
    let (package, rest) = path.split_once('/')?;
    let folders = || folder.ancestors().take(MOST_FOLDERS_UP);
    let is_package = |folder: &Path| {
        let manifest =
            catch_recording::bounded_file::FileKind::toml("a manifest").read_text(&folder.join("package.xml"));
        manifest.is_ok_and(|text| text.contains(&format!("<name>{package}</name>")))
    };
    let by_name = folders()
        .filter(|it| it.file_name().is_some_and(|name| name == package))
        .find_map(|it| existing(it.join(rest)));
    by_name
        .or_else(|| folders().find_map(|it| existing(it.join(package).join(rest))))
        .or_else(|| folders().filter(|it| is_package(it)).find_map(|it| existing(it.join(rest))))
        .or_else(|| below_some_folder(&folder, Path::new(rest)))
}

/// `path` below one of the folders above.
fn below_some_folder(folder: &Path, path: &Path) -> Option<PathBuf> {
    let is_plain = path.components().all(|it| matches!(it, Component::Normal(_)));
    folder.ancestors().take(if is_plain { 4 } else { 0 }).find_map(|it| existing(it.join(path)))
}

fn existing(path: PathBuf) -> Option<PathBuf> {
    path.is_file().then_some(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn packages_are_found_by_walking_up() {
        let folder = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(folder.path()).unwrap();
        let write = |path: &str| {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, "<name>arm_support</name>").unwrap();
            path
        };
        let urdf = write("ws/arm/urdf/arm.urdf");
        let mesh = write("ws/arm/meshes/a.stl");
        let other = write("ws/hand/meshes/b.stl");
        write("ws/arm/package.xml");
        assert_eq!(resolve(&urdf, "package://arm/meshes/a.stl"), Some(mesh.clone()));
        assert_eq!(resolve(&urdf, "package://hand/meshes/b.stl"), Some(other.clone()));
        assert_eq!(resolve(&urdf, "package://arm_support/meshes/a.stl"), Some(mesh.clone()));
        assert_eq!(resolve(&urdf, "../meshes/a.stl").map(|it| fs::canonicalize(it).unwrap()), Some(mesh.clone()));
        assert_eq!(resolve(&urdf, &format!("file://{}", other.display())), Some(other));
        assert_eq!(resolve(&urdf, "package://none/meshes/c.stl"), None);
        assert_eq!(resolve(&urdf, "package://none"), None);
    }
}
