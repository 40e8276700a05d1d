// Shapes of the values that server and page exchange.

/** @typedef {[number, number]} Place */
/** @typedef {Place[]} Ring */
/** @typedef {Ring[]} Rings */
/**
 * @typedef {object} PlanDocument
 * @property {Rings[]} areas
 * @property {Rings[]} no_go
 * @property {Place[]} starts
 * @property {Place[]} stakes
 * @property {Place[]} checkpoints
 * @property {Record<string, any>} planner
 * @property {Record<string, any>} rover
 * @property {Record<string, any>} fleet
 * @property {Record<string, any>} requirement
 * @property {Record<string, any>} simulation
 * @property {string} notes
 * @property {Record<string, string>} measured
 */
/** @typedef {{name: string, help: string, default: any, kind: string, choices: string[]}} Field */
/**
 * @typedef {object} Site
 * @property {string} name
 * @property {string} terrain
 * @property {string} folder
 * @property {string} notice What has changed since the plan was drawn; empty where nothing has.
 * @property {{name: string, code: string}} crs
 * @property {number} grid_per_ground
 * @property {TileGrid} tiles
 * @property {TerrainStyle} style
 * @property {string[]} height_colours
 * @property {string[]} slope_colours
 * @property {number} largest_slope_deg
 * @property {Background|null} background
 */
/** @typedef {{extent: number[], tile_cells: number, resolutions_m: number[]}} TileGrid */
/** @typedef {{centre: number[], scale: number, offset: number[], powers: [number, number][], factors: number[][]}} Polynomial */
/** @typedef {{title: string, kind: string, address: string, grid?: TileGrid, to_mercator?: Polynomial, from_mercator?: Polynomial}} Background */
/** @typedef {{text: string, low_m: number, high_m: number}} TerrainStyle */
/** @typedef {{planner: Record<string, Field[]>, rover: Field[], fleet: Field[], requirement: Field[], simulation: Field[]}} Fields */
/** @typedef {{kind: string, rover: number, places: Place[]}} Leg */
/**
 * @typedef {object} PlanSummary
 * @property {number} revision
 * @property {boolean} is_provisional
 * @property {boolean} has_error
 * @property {string} no_error_because
 * @property {Leg[]} legs
 * @property {string} swaths
 * @property {number|null} spacing_m
 * @property {number} area_m2
 * @property {{name: string, title: string, text: string, value: number}[]} facts
 * @property {{rings: Rings, reason: string, text: string}[]} left_out
 * @property {string} command
 */
/**
 * @typedef {object} ErrorMap
 * @property {boolean} is_provisional
 * @property {string} detail
 * @property {number[]} bounds
 * @property {string|null} image
 * @property {number} top_m
 * @property {string[]} colours
 * @property {number} rmse_m
 * @property {number} p95_m
 * @property {number} worst_m
 */
/** @typedef {{name: string, title: string, facts: Record<string, string>, folder: string, has_report: boolean, error?: string}} RunRow */
/**
 * @typedef {object} RoverDrive
 * @property {number} rover
 * @property {Place[]} places
 * @property {(number|null)[]} heights_m
 * @property {number[]} distance_m
 * @property {number[]} time_s
 * @property {number[]} energy_j
 * @property {number[]|null} battery_share
 * @property {[number, number][]} swaths
 */
export {};
