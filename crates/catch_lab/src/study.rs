//! Studies: many variants of one scenario, each evaluated with the same seed.
//!
//! A study is a TOML file that lists overlays of a scenario. A step is the scenario with one of them laid
//! over it, or with several one upon the other. All steps draw from the same random streams, so that throw
//! number 17 is the same in each where throws are random. `assets/studies/ablation.toml` shows every field.

mod outline;
pub mod throw_grid;

use std::path::PathBuf;

use catch_body::InputError;
use serde::Deserialize;

use crate::{
    assets::{Asset, Kind, Origin},
    evaluation::Cell,
    scenario::{
        Scenario,
        setup::{Choice, Setup},
    },
};
pub use outline::{ObjectSummary, Outline, StepHead, StepSummary};
use throw_grid::ThrowGrid;

/// A study's file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyFile {
    /// Description of the study, in a sentence.
    pub description: String,
    /// The scenario that the overlays are laid over: a built-in name, or a path relative to this file.
    pub scenario: String,
    /// The scenario from which overlays take fields.
    #[serde(default)]
    pub towards: Option<String>,
    /// Objects that are thrown; every built-in object if left out.
    #[serde(default)]
    pub objects: Vec<String>,
    /// Throws that are used; those of the scenario if left out. The trials of an object are divided among the
    /// throws.
    #[serde(default)]
    pub throws: Vec<String>,
    /// Throws from a grid of places and speeds, made after the throw.
    #[serde(default)]
    pub throw_grid: Option<ThrowGrid>,
    /// Rule by which overlays become steps.
    #[serde(default)]
    pub combine: Combine,
    /// The overlays.
    #[serde(rename = "overlay")]
    pub overlays: Vec<Overlay>,
}

/// Rule by which overlays become steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Combine {
    /// Each alone upon the scenario.
    #[default]
    Each,
    /// Each upon those before it.
    Cumulative,
    /// Both; what changes nothing is not repeated alone.
    CumulativeThenEach,
}

/// Changes of one variant to the scenario.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Overlay {
    /// Name: letters, digits, `_` and `-`.
    pub name: String,
    /// Description of the change, in words.
    #[serde(default)]
    pub about: String,
    /// Other throws, from here on where overlays are laid upon each other.
    #[serde(default)]
    pub throws: Vec<String>,
    /// Paths of fields that are taken over from the other scenario.
    #[serde(default)]
    pub take: Vec<String>,
    /// Path of a field → its new value.
    #[serde(default)]
    pub set: toml::Table,
    /// Path of a field → its new value, only where the overlay stands alone.
    #[serde(default)]
    pub set_alone: toml::Table,
}

impl Overlay {
    fn changes_nothing(&self) -> bool {
        *self == Self { name: self.name.clone(), about: self.about.clone(), ..Self::default() }
    }
}

/// A study, read and checked.
#[derive(Debug, Clone)]
pub struct Study {
    /// Name: that of its file.
    pub name: String,
    /// Content of the study's file.
    pub file: StudyFile,
    /// Steps of the study in their order.
    pub steps: Vec<Step>,
    /// Name of the study's file in error messages.
    path: String,
    /// Origin of the files that its scenario names.
    origin: Origin,
}

/// A variant of the scenario with its throws.
#[derive(Debug, Clone)]
pub struct Step {
    /// Name, that of its folder, and what it changes.
    pub head: StepHead,
    /// The scenario.
    pub scenario: Scenario,
    /// The ways of throwing.
    pub throws: Vec<String>,
}

impl Study {
    /// Reads a built-in study, or a file.
    ///
    /// # Errors
    /// A study that there is not, or a fault in it or in its scenarios; `asked_by` is the file and field, or
    /// the argument, that names it.
    pub fn load(name: &str, asked_by: (&str, &str)) -> Result<Self, InputError> {
        Self::of(Asset::find(Kind::Study, name, &Origin::BuiltIn(PathBuf::new()), asked_by)?)
    }

    /// Reads the study in `asset`.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn of(asset: Asset) -> Result<Self, InputError> {
        let mut file: StudyFile = InputError::parse_toml(&asset.file, &asset.text)?;
        let scenario = |name: &str, field: &str| {
            let found = Asset::find(Kind::Scenario, name, &asset.origin, (&asset.file, field))?;
            Ok((Scenario::of_asset(&found)?, found.origin))
        };
        let (base, origin) = scenario(&file.scenario, "scenario")?;
        let towards = file.towards.as_ref().map(|name| Ok(scenario(name, "towards")?.0)).transpose()?;
        for throw in file.throws.iter_mut().chain(file.overlays.iter_mut().flat_map(|it| &mut it.throws)) {
            *throw = beside(&asset.origin, Kind::Throw, throw);
        }
        for object in &mut file.objects {
            *object = beside(&asset.origin, Kind::Object, object);
        }
        let steps = steps(&asset.file, &file, &base, towards.as_ref())?;
        Ok(Self { name: asset.name, path: asset.file, file, steps, origin })
    }

    /// Returns the objects that are thrown in the study.
    pub fn objects(&self) -> Vec<String> {
        match &self.file.objects[..] {
            [] => Kind::Object.names().into_iter().map(str::to_owned).collect(),
            named => named.to_vec(),
        }
    }

    /// Returns the data of the study that its report needs.
    pub fn outline(&self, seed: u64) -> Outline {
        Outline {
            version: crate::VERSION.to_owned(),
            study: self.name.clone(),
            description: self.file.description.clone(),
            seed,
            throw_grid: self.file.throw_grid.clone(),
            steps: self.steps.iter().map(|step| step.head.clone()).collect(),
        }
    }

    /// The cells of a step, object by object, with another arm or gripper than the scenario's where
    /// `equipment` names one.
    ///
    /// # Errors
    /// As [`Setup::load`]; a throw that no place of the grid can be made after.
    pub fn cells(&self, step: &Step, equipment: &Choice, objects: &[String]) -> Result<Vec<Cell>, InputError> {
        let mut cells = Vec::new();
        for object in objects {
            for throw in &step.throws {
                let choice = Choice { object: Some(object), throw: Some(throw), ..*equipment };
                let file = format!("{}, step {}", self.path, step.head.name);
                let setup = Setup::of_scenario(step.scenario.clone(), &file, &self.origin, &choice)?;
                let Some(grid) = &self.file.throw_grid else {
                    cells.push(Cell::new(setup));
                    continue;
                };
                let before = cells.len();
                cells.extend(grid.throws(&setup).map(|(name, throw)| Cell::new(setup.with_throw(name, throw))));
                if cells.len() == before {
                    let expected = "one that passes the arm within two seconds";
                    return Err(InputError::new(&self.path, "throws", throw, expected));
                }
            }
        }
        Ok(cells)
    }
}

/// Finds the asset that a study calls by this name: something built in, or a file beside it.
fn beside(origin: &Origin, kind: Kind, name: &str) -> String {
    match origin {
        Origin::Disk(folder) if !kind.names().contains(&name) => folder.join(name).display().to_string(),
        _ => name.to_owned(),
    }
}

fn steps(file: &str, study: &StudyFile, base: &Scenario, towards: Option<&Scenario>) -> Result<Vec<Step>, InputError> {
    check(file, study)?;
    let or = |throws: &[String], otherwise: &[String]| {
        if throws.is_empty() { otherwise.to_vec() } else { throws.to_vec() }
    };
    let first = or(&study.throws, std::slice::from_ref(&base.throw));
    let mut steps = Vec::new();
    if study.combine != Combine::Each {
        let (mut scenario, mut throws) = (base.clone(), first.clone());
        for (i, overlay) in study.overlays.iter().enumerate() {
            scenario = overlay.over(file, scenario, towards, false)?;
            throws = or(&overlay.throws, &throws);
            let head =
                StepHead { name: format!("{:02}-{}", i + 1, overlay.name), about: overlay.about.clone(), alone: false };
            steps.push(Step { scenario: named(scenario.clone(), &head.name, towards), head, throws: throws.clone() });
        }
    }
    if study.combine != Combine::Cumulative {
        let both = study.combine == Combine::CumulativeThenEach;
        for overlay in study.overlays.iter().filter(|overlay| !(both && overlay.changes_nothing())) {
            let name = if both { format!("only-{}", overlay.name) } else { overlay.name.clone() };
            let head = StepHead { name, about: overlay.about.clone(), alone: true };
            let scenario = overlay.over(file, base.clone(), towards, true)?;
            steps.push(Step {
                scenario: named(scenario, &head.name, towards),
                head,
                throws: or(&overlay.throws, &first),
            });
        }
    }
    Ok(steps)
}

/// The scenario of a step bears the step's name; one from which nothing is left to take is the other
/// scenario.
fn named(scenario: Scenario, step: &str, towards: Option<&Scenario>) -> Scenario {
    let Some(towards) = towards else { return Scenario { name: step.to_owned(), ..scenario } };
    let there = Scenario { name: towards.name.clone(), description: towards.description.clone(), ..scenario.clone() };
    if there == *towards { there } else { Scenario { name: step.to_owned(), ..scenario } }
}

/// Checks a study without its overlays.
fn check(file: &str, study: &StudyFile) -> Result<(), InputError> {
    let fault = |field: &str, found: String, expected: &str| Err(InputError::new(file, field, found, expected));
    if study.overlays.is_empty() {
        return fault("overlay", "none".to_owned(), "one overlay or more");
    }
    if let Some(grid) = &study.throw_grid {
        grid.check(file)?;
    }
    for (i, overlay) in study.overlays.iter().enumerate() {
        let name = &overlay.name;
        let fits = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
        if name.is_empty() || !name.chars().all(fits) {
            return fault("overlay.name", format!("`{name}`"), "letters, digits, `_` and `-`: it becomes a folder's");
        }
        if study.overlays[..i].iter().any(|other| other.name == *name) {
            return fault("overlay.name", format!("`{name}` twice"), "a name of its own for each");
        }
        if study.towards.is_none() && !overlay.take.is_empty() {
            return fault("towards", "nothing".to_owned(), &format!("the scenario from which `{name}` takes fields"));
        }
        if study.throw_grid.is_some() && (study.throws.len() > 1 || overlay.throws.len() > 1) {
            return fault("throws", "several".to_owned(), "one: that which the throws of the grid are made after");
        }
    }
    Ok(())
}

impl Overlay {
    /// A scenario with this laid over it.
    fn over(
        &self,
        file: &str,
        mut scenario: Scenario,
        towards: Option<&Scenario>,
        alone: bool,
    ) -> Result<Scenario, InputError> {
        for path in &self.take {
            let fault = |expected: String| InputError::new(file, "overlay.take", format!("`{path}`"), expected);
            let value = match towards.map(|it| it.field(path, &fault)) {
                // It is left out there: an optional field, since it stands here.
                Some(Err(_)) if scenario.field(path, &fault).is_ok_and(|it| it.is_some()) => None,
                there => there.transpose()?.flatten(),
            };
            scenario = scenario.with_field(path, value, &fault)?;
        }
        let alone = self.set_alone.iter().filter(|_| alone);
        for (path, value) in self.set.iter().chain(alone) {
            let fault =
                |expected: String| InputError::new(file, "overlay.set", format!("`{path} = {value}`"), expected);
            scenario = scenario.with_field(path, Some(value.clone()), &fault)?;
        }
        scenario.faults(file).into_iter().next().map_or(Ok(scenario), Err)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_recording::brain::Method;

    fn load(name: &str) -> Study {
        Study::load(name, ("test", "name")).unwrap()
    }

    fn built_in(name: &str) -> Scenario {
        let asset = Asset::find(Kind::Scenario, name, &Origin::BuiltIn(PathBuf::new()), ("test", "name")).unwrap();
        Scenario::of_asset(&asset).unwrap()
    }

    /// If a setting of the honest scenario is no part of any overlay, the top is not honest.
    #[test]
    fn the_ablation_ends_at_honest() {
        let study = load("ablation");
        assert_eq!(study.steps.len(), 2 * study.file.overlays.len() - 1);
        assert_eq!(study.steps[0].scenario, Scenario { name: "01-paper".to_owned(), ..built_in("paper") });
        let top = &study.steps[study.file.overlays.len() - 1];
        assert_eq!(top.scenario, built_in("honest"));
        assert_eq!(top.throws, ["random"]);
        let honest = Setup::load(&Choice { scenario: Some("honest"), object: Some("banana"), ..Choice::default() });
        let cells = study.cells(top, &Choice::default(), &["banana".to_owned()]).unwrap();
        assert_eq!(cells[0].setup.scenario, honest.unwrap().scenario);
    }

    /// Without any assumption of the published code, the paper's method under the arm's limits is left.
    #[test]
    fn the_published_system_ends_at_its_method_in_the_scenario_of_the_paper() {
        let study = load("as-published");
        assert_eq!(
            study.steps[0].scenario,
            Scenario { name: "01-as-published".to_owned(), ..built_in("as-published") }
        );
        let top = &study.steps[study.file.overlays.len() - 1];
        let mut paper = built_in("paper");
        paper.brain.method = Method::Paper;
        let Scenario { name, description, .. } = top.scenario.clone();
        assert_eq!(top.scenario, Scenario { name, description, ..paper });
        assert_eq!(top.throws, ["near", "far"]);
    }

    /// The scenario `honest-aero` is `honest` but for the air and for what the brain does about it.
    #[test]
    fn honest_aero_is_honest_with_other_air() {
        let (honest, mut aero) = (built_in("honest"), built_in("honest-aero"));
        assert_ne!(aero.arena.aerodynamics, honest.arena.aerodynamics);
        aero.arena.aerodynamics = honest.arena.aerodynamics;
        let (prediction, of_honest) = (&mut aero.brain.trajectory_prediction, &honest.brain.trajectory_prediction);
        (prediction.process_noise, prediction.aerodynamics) = (of_honest.process_noise, of_honest.aerodynamics);
        let (planning, of_honest) = (&mut aero.brain.trajectory_optimization, &honest.brain.trajectory_optimization);
        planning.reach_fractions.clone_from(&of_honest.reach_fractions);
        (aero.name, aero.description) = (honest.name.clone(), honest.description.clone());
        assert_eq!(aero, honest);
    }

    #[test]
    fn every_overlay_changes_the_scenario_or_its_throws() {
        for name in Kind::Study.names() {
            let study = load(name);
            let base = built_in(&study.file.scenario);
            for step in study.steps.iter().filter(|step| step.head.alone) {
                let same = Scenario { name: base.name.clone(), ..step.scenario.clone() } == base;
                assert!(!same || step.throws != study.file.throws || step.head.name == "ours", "{}", step.head.name);
            }
        }
    }

    /// Common random numbers: the same throw in every step where throws are random, as far as it is not its
    /// speed through the air.
    #[test]
    fn throws_are_the_same_in_all_steps() {
        let study = load("ablation");
        let random = study.steps.iter().filter(|step| step.throws == ["random"]);
        let release = |step: &Step| {
            study.cells(step, &Choice::default(), &["banana".to_owned()]).unwrap()[0].setup.release(1, 17)
        };
        let random: Vec<_> = random.map(release).collect();
        assert!(random.len() > 8);
        assert!(random.iter().all(|it| (it.p_WO, it.q_WO) == (random[0].p_WO, random[0].q_WO)));
    }

    #[test]
    fn faults_are_named() {
        for (overlays, hint) in [
            ("[[overlay]]\nname = \"a/b\"", "overlay.name: found `a/b`"),
            ("[[overlay]]\nname = \"a\"\n[[overlay]]\nname = \"a\"", "`a` twice"),
            ("[[overlay]]\nname = \"a\"\ntake = [\"clock\"]", "towards: found nothing"),
            ("[[overlay]]\nname = \"a\"\nset = { \"arena.frictoin\" = 1 }", "did you mean `arena.friction`?"),
            ("[[overlay]]\nname = \"a\"\nset = { \"arena.friction\" = -1.0 }", "arena.friction: found -1"),
            ("towards = \"honest\"\n[[overlay]]\nname = \"a\"\ntake = [\"arena.dag\"]", "did you mean `arena.drag`?"),
            ("overlay = []", "one overlay or more"),
        ] {
            let text = format!("description = \"\"\nscenario = \"paper\"\n{overlays}\n");
            let (name, file, origin) = ("mine".to_owned(), "mine.toml".to_owned(), Origin::Disk(PathBuf::new()));
            let fault = Study::of(Asset { name, file, text, origin }).unwrap_err().to_string();
            assert!(fault.starts_with("mine.toml") && fault.contains(hint), "{fault}");
        }
    }
}
