//! The command of a sweep in words, for messages, scripts and provenance.

use super::SweepArgs;
use crate::ChangeArgs;
use city3d_simulation::scenario::ScenarioChange;
use clap::ValueEnum;
use std::borrow::Cow;

/// The words of the command that has these runs and this folder: `sweep` and what follows it.
pub fn words(args: &SweepArgs) -> Vec<String> {
    let ChangeArgs { seed, duration, model, environment, set } = &args.scenario.changed;
    let mut words = vec!["sweep".to_owned(), args.scenario.scenario.clone()];
    let mut add = |option: &str, value: Option<String>| {
        words.extend(value.into_iter().flat_map(|value| [option.to_owned(), value]));
    };
    add("--seed", seed.map(|seed| seed.to_string()));
    add("--duration", duration.map(|duration| duration.to_string()));
    add("--model", model.as_ref().map(name));
    add("--environment", environment.as_ref().map(name));
    for change in set {
        add("--set", Some(change_word(change)));
    }
    add("--seeds", args.seeds.as_ref().map(ToString::to_string));
    add("--out", Some(args.out.display().to_string()));
    words
}

/// The same as a line for a shell, with more words behind.
pub fn line(args: &SweepArgs, more: &[&str]) -> String {
    let words = words(args);
    let all = std::iter::once("city3d").chain(words.iter().map(String::as_str)).chain(more.iter().copied());
    all.map(quoted).collect::<Vec<_>>().join(" ")
}

/// A word as a shell reads it.
pub fn quoted(word: &str) -> Cow<'_, str> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_./:,=@%+-".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return Cow::Borrowed(word);
    }
    Cow::Owned(format!("'{}'", word.replace('\'', r"'\''")))
}

fn name<V: ValueEnum>(value: &V) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// A change as it is read from a command, without quotes where it needs none.
fn change_word(change: &ScenarioChange) -> String {
    let plain = format!("{}={}", change.key, change.value.as_str().unwrap_or_default());
    if plain.parse().as_ref() == Ok(change) { plain } else { change.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cli;
    use clap::Parser;

    fn read(words: &[String]) -> SweepArgs {
        let all = std::iter::once("city3d".to_owned()).chain(words.iter().cloned());
        match Cli::try_parse_from(all).unwrap().command {
            Some(crate::Command::Sweep(args)) => args,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_command_comes_back_as_it_was_given() {
        let line = "sweep my\tscene.toml --seed 7 --duration 0.5 --model bicycle --environment testbed --set a.b=0:0.2:0.1 \
                    --set c=fifo,it's --set d=true --set e=\"7\" --set f=1.5 --out o";
        let given: Vec<String> = line.split(' ').filter(|w| !w.is_empty()).map(str::to_owned).collect();
        let args = read(&given);
        let again = read(&words(&args));
        assert_eq!((&again.scenario, &again.out), (&args.scenario, &args.out));
        let seeds: Vec<String> = ["sweep", "s", "--seeds", "3,4,5", "--out", "o"].map(str::to_owned).into();
        assert_eq!(words(&read(&seeds))[2..4], ["--seeds", "3..5"]);
    }

    #[test]
    fn a_shell_reads_quoted_words_as_they_are() {
        for word in ["plain-1_2./:,=@%+", "", "two words", "it's", "$HOME `x` \"y\" \\ * \n", "\u{e9}"] {
            let command = format!("printf %s {}", quoted(word));
            let output = std::process::Command::new("sh").args(["-c", &command]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), word);
        }
    }
}
