// Values in the page's address: #kd=0.6,0.3,0.2&specular.0.shininess=40

function fromAddress(hash) {
  const parts = hash.replace(/^#/, "").split("&").filter(Boolean);
  return Object.fromEntries(parts.map((part) => {
    const [name, numbers = ""] = part.split("=").map(decodeURIComponent);
    return [name, numbers.split(",").map((text) => (text.trim() ? Number(text) : NaN))];
  }));
}

// What differs from the values that the page came with.
function toAddress() {
  const changed = [...parameters.values()].filter((one) => `${one.values}` !== `${values.get(one.name)}`);
  return changed.map((one) => `${one.name}=${values.get(one.name).map(encodeURIComponent).join(",")}`).join("&");
}
