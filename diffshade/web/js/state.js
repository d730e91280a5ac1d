// The values of the coefficients, by name. Who shows them is told of every change.

const data = JSON.parse(document.getElementById("scene").textContent);
const parameters = new Map(data.parameters.map((one) => [one.name, one]));
const SIZES = { channels: [1, 3], number: [1], position: [3], direction: [3] };

const values = new Map();
const listeners = [];

function start() {
  for (const [name, one] of parameters) values.set(name, [...one.values]);
}

function tell() {
  for (const listener of listeners) listener();
}

function reset() {
  start();
  tell();
}

function get(name) {
  return [...values.get(known(name).name)];
}

// Several values at once: {name: number, or one a channel}. All are set, or none.
function set(changes) {
  const checked = Object.entries(changes).map(([name, value]) => [name, usable(known(name), value)]);
  for (const [name, numbers] of checked) values.set(name, numbers);
  tell();
}

function known(name) {
  const one = parameters.get(name);
  if (one) return one;
  throw new RangeError(`${name}: there is no such value; there are ${[...parameters.keys()].join(", ")}`);
}

function usable(one, value) {
  const numbers = [value].flat();
  const sizes = SIZES[one.kind];
  if (!sizes.includes(numbers.length)) {
    throw new RangeError(`${one.name}: ${numbers.length} numbers are given; give ${sizes.join(" or ")}`);
  }
  for (const x of numbers) {
    if (typeof x !== "number" || !Number.isFinite(x)) throw new RangeError(`${one.name}: ${x} is no number`);
    if (one.least !== null && x < one.least) throw new RangeError(`${one.name}: ${x} is below ${one.least}`);
    if (one.most !== null && x > one.most) throw new RangeError(`${one.name}: ${x} is above ${one.most}`);
  }
  return numbers;
}

start();
