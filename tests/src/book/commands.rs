//! Commands in Markdown: those in fences, which people copy, and those in running text.

use std::path::Path;

/// A fenced block.
#[derive(Debug, Clone)]
pub struct Block {
    /// What the fence says it is: `sh`, `python`, ...
    pub language: String,
    /// Line of its first line, from 1.
    pub line: usize,
    /// What it holds, without the indentation of its fence.
    pub text: String,
}

/// A command that a page tells people to type.
#[derive(Debug, Clone)]
pub struct Command {
    /// The page.
    pub page: String,
    /// Its line there, from 1.
    pub line: usize,
    /// As it is typed, on one line, without the remark behind it.
    pub text: String,
}

impl Command {
    /// Its words, without what it sets for itself in the environment and without `sudo`.
    pub fn words(&self) -> Vec<String> {
        let words = words(&self.text);
        let set = words.iter().take_while(|word| {
            word.split_once('=').is_some_and(|(name, _)| {
                !name.is_empty() && name.chars().all(|letter| letter.is_ascii_uppercase() || letter == '_')
            })
        });
        let count = set.count();
        words[count..].iter().skip_while(|word| *word == "sudo").cloned().collect()
    }
}

/// The fenced blocks of `page`.
///
/// # Errors
/// Where it cannot be read.
pub fn blocks(page: &Path) -> std::io::Result<Vec<Block>> {
    let text = std::fs::read_to_string(page)?;
    let mut blocks = Vec::new();
    let mut open: Option<(Block, usize)> = None;
    for (number, line) in text.lines().enumerate() {
        let indent = line.len() - line.trim_start().len();
        match (open.take(), line.trim_start().strip_prefix("```")) {
            (None, Some(language)) => {
                let block = Block { language: language.trim().into(), line: number + 2, text: String::new() };
                open = Some((block, indent));
            }
            (None, None) => {}
            (Some((block, _)), Some(_)) => blocks.push(block),
            (Some((mut block, fence)), None) => {
                block.text += line.get(fence.min(indent)..).unwrap_or_default();
                block.text.push('\n');
                open = Some((block, fence));
            }
        }
    }
    Ok(blocks)
}

/// The commands of a shell's block: a line each, or more where `&&` joins them; a line that ends in `\` goes on in the next.
pub fn commands(page: &str, block: &Block) -> Vec<Command> {
    let mut commands = Vec::new();
    let mut pending: Option<(usize, String)> = None;
    for (number, line) in block.text.lines().enumerate() {
        let (first, mut whole) = pending.take().unwrap_or((number, String::new()));
        if let Some(part) = line.trim_end().strip_suffix('\\') {
            whole += part.trim_start();
            pending = Some((first, whole));
            continue;
        }
        whole += line.trim_start();
        for text in parts(&whole) {
            commands.push(Command { page: page.into(), line: block.line + first, text });
        }
    }
    commands
}

/// A line as a shell takes it apart: at `&&`, without what is behind a `#`.
fn parts(line: &str) -> Vec<String> {
    let mut parts = vec![String::new()];
    let mut quote = None;
    let mut before = ' ';
    for letter in line.chars() {
        match quote {
            None if letter == '#' && before.is_whitespace() => break,
            None if letter == '\'' || letter == '"' => quote = Some(letter),
            Some(open) if open == letter => quote = None,
            _ => {}
        }
        let part = parts.last_mut().expect("one at least");
        if quote.is_none() && letter == '&' && before == '&' {
            part.pop();
            parts.push(String::new());
        } else {
            part.push(letter);
        }
        before = letter;
    }
    parts.into_iter().map(|part| part.trim().to_owned()).filter(|part| !part.is_empty()).collect()
}

/// A command's words, as a shell splits them.
fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for letter in text.chars() {
        match quote {
            Some(open) if open == letter => quote = None,
            Some(_) => word.get_or_insert_default().push(letter),
            None if letter == '\'' || letter == '"' => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            None if letter.is_whitespace() => words.extend(word.take()),
            None => word.get_or_insert_default().push(letter),
        }
    }
    words.extend(word);
    words
}

/// Commands of `program` between backticks in running text: its words, from the one behind its name on.
///
/// # Errors
/// Where the page cannot be read.
pub fn mentions(page: &Path, program: &str) -> std::io::Result<Vec<Vec<String>>> {
    let text = std::fs::read_to_string(page)?;
    let mut fenced = false;
    let running: String = text
        .lines()
        .filter(|line| {
            let is_fence = line.trim_start().starts_with("```");
            fenced ^= is_fence;
            !fenced && !is_fence
        })
        .flat_map(|line| [line, "\n"])
        .collect();
    let spans = running.split('`').skip(1).step_by(2);
    let opening = format!("{program} ");
    Ok(spans.filter_map(|span| span.strip_prefix(&opening).map(words)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_the_program() {
        let command = |text: &str| Command { page: "p".into(), line: 1, text: text.into() };
        assert_eq!(command("A_B=1 sudo rig estop 'a b'").words(), ["rig", "estop", "a b"]);
        assert_eq!(command("rig new a=b").words(), ["rig", "new", "a=b"]);
    }

    #[test]
    fn commands_are_what_a_shell_would_make_of_the_block() {
        let block = Block {
            language: "sh".into(),
            line: 10,
            text: "a 'x # y' && b   # why\n\nLEFT=1 c --d \\\n    \"e f\" g#h\n".into(),
        };
        let commands = commands("p", &block);
        let texts: Vec<_> = commands.iter().map(|command| (command.line, command.text.as_str())).collect();
        assert_eq!(texts, [(10, "a 'x # y'"), (10, "b"), (12, "LEFT=1 c --d \"e f\" g#h")]);
        assert_eq!(commands[2].words(), ["c", "--d", "e f", "g#h"]);
    }
}
