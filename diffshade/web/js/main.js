// The page comes to life.

const byId = (name) => document.getElementById(name);

function trouble(error) {
  byId("trouble").textContent = error.message;
  byId("trouble").hidden = false;
}

function say(words) {
  byId("status").textContent = words;
}

// What a person has asked for; what cannot be is said, and nothing changes.
function attempt(change) {
  try {
    change();
    say("");
  } catch (error) {
    say(error.message);
    tell();
  }
}

async function copy(text, words) {
  try {
    await navigator.clipboard.writeText(text);
    say(words);
  } catch {
    say("The browser keeps its clipboard: copy the text below.");
    byId("toml").closest("details").open = true;
    byId("toml").select();
  }
}

function chooseLights() {
  const draggable = data.lights;
  let chosen = draggable[0];
  if (!chosen) return;
  byId("hint").hidden = false;
  byId("lights").hidden = draggable.length < 2;
  byId("lights").append(...draggable.map((light) => element(
    "label", {},
    element("input", { type: "radio", name: "light", onchange: () => { chosen = light; }, ...(light === chosen && { checked: "" }) }),
    ` ${light.words}`,
  )));
  dragging(() => chosen);
}

try {
  const picture = await Picture.from(data.surface.textures);
  const refresh = controls(byId("sliders"), attempt);
  listeners.push(() => picture.draw(), refresh, () => { byId("toml").value = toml(); });
  const readAddress = () => attempt(() => {
    start();
    set(fromAddress(location.hash));
  });
  byId("reset").addEventListener("click", () => attempt(reset));
  byId("copy-toml").addEventListener("click", () => copy(toml(), "Copied."));
  byId("copy-link").addEventListener("click", () => {
    history.replaceState(null, "", `#${toAddress()}`);
    copy(location.href, "Copied.");
  });
  addEventListener("hashchange", readAddress);
  chooseLights();
  const some = data.parameters.slice(0, 2);
  byId("example").textContent = `#${some.map((one) => `${one.name}=${one.values.join(",")}`).join("&")}`;
  byId("names").append(...data.parameters.map((one) => element("li", {}, element("code", {}, one.name))));
  readAddress();
  window.diffshade = { get, set, reset, toml, names: [...parameters.keys()] };
} catch (error) {
  trouble(error);
}
