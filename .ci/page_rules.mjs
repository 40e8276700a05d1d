// Rules for the modules of the desk's page; TypeScript checks names and types.
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const js = createRequire(pathToFileURL(`${process.env.PAGE_TOOLS}/`))("@eslint/js");

export default [
  js.configs.recommended,
  {
    rules: {
      "no-undef": "off",
      "no-var": "error",
      "prefer-const": "error",
      eqeqeq: "error",
      "no-eval": "error",
      "no-implied-eval": "error",
      "no-new-func": "error",
      "no-restricted-properties": ["error", { property: "innerHTML", message: "Make elements; text from files is not markup." }, { property: "outerHTML" }, { property: "insertAdjacentHTML" }],
      "no-shadow": "error",
      "no-unused-expressions": ["error", { allowShortCircuit: true, allowTernary: true }],
      complexity: ["error", 14],
      "max-lines": ["error", 250],
      "max-lines-per-function": ["error", 70],
    },
  },
];
