// The scene as a scene.toml: its text with the blanks filled in.

function toml() {
  return data.toml.replace(/\$\{([\w.]+)\}/g, (_, name) => written(parameters.get(name), values.get(name)));
}

function written(one, numbers) {
  const listed = one.kind === "position" || one.kind === "direction" || numbers.length > 1;
  return listed ? `[${numbers.join(", ")}]` : `${numbers[0]}`;
}
